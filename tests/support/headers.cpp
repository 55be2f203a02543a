// SPDX-License-Identifier: Apache-2.0
// This file is empty. Its target compiles the headers that tests share once (tests/CMakeLists.txt).
