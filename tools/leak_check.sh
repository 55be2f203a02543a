#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds the library and its tests with AddressSanitizer and UndefinedBehaviorSanitizer (preset `debug`, only
# these targets) and runs the tests. They use two devices in a process and two threads with a renderer each, and
# create and free handles. Fails if memory leaks or is misused. It takes minutes, so run it by hand; it is not
# part of ctest (docs/library.md).
#   tools/leak_check.sh [CMake option ...]
set -eu
cd "$(dirname "$0")/.."
cmake --preset debug -DUBS_CUDA=OFF -DUBS_SERVE=OFF -DUBS_MPI=OFF "$@"
cmake --build --preset debug --target test_library_c test_library
suppressions=$(mktemp)
trap 'rm -f "$suppressions"' EXIT
# PoCL and its compiler keep some memory until the process ends.
printf 'leak:libpocl\nleak:libLLVM\n' >"$suppressions"
export UBS_CHECK=off UBS_TUNING=off ASAN_OPTIONS=detect_leaks=1 LSAN_OPTIONS="suppressions=$suppressions"
build-debug/tests/library/test_library_c
build-debug/tests/library/test_library
