// SPDX-License-Identifier: Apache-2.0
// Empty: its target holds the headers that tests share, compiled once (tests/CMakeLists.txt).
