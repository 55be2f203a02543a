// SPDX-License-Identifier: Apache-2.0
// This file is empty. Its target precompiles the headers that the tests share (tests/CMakeLists.txt).
