#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Compiles for other platforms and runs the tests that need no device there (docs/library.md). Run it by hand;
# it is not part of ctest.
#   tools/cross_check.sh arm64 FOLDER     the lean executable and library, host tests, and the CUDA back end
#                                         with the host as device, under qemu-user
#   tools/cross_check.sh windows FOLDER   the core without its POSIX files, and its host tests under wine
# Requires Debian 12 with g++-aarch64-linux-gnu and qemu-user-static, or with g++-mingw-w64-x86-64-posix and
# wine64. The libraries are Debian's packages for arm64, unpacked to FOLDER and not installed; for Windows
# only their headers are used.
set -eu
usage="usage: cross_check.sh arm64|windows FOLDER"
target=${1:?$usage} folder=${2:?$usage}
root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "$folder" && folder=$(cd "$folder" && pwd)
system=$folder/root triple=aarch64-linux-gnu
if [ ! -d "$system" ]; then
  mkdir -p "$folder/lists/partial" "$folder/deb" "$folder/part"
  arm64() {
    apt-get -qq -oAPT::Architecture=arm64 -oAPT::Architectures=arm64 -oDir::State::Lists="$folder/lists" \
      -oDir::Cache="$folder" -oDir::State::status=/dev/null "$@"
  }
  arm64 update
  (cd "$folder/deb" && arm64 download ocl-icd-libopencl1 ocl-icd-opencl-dev opencl-c-headers opencl-clhpp-headers \
    libclblast1 libclblast-dev libfmt9 libfmt-dev libyaml-cpp0.7 libyaml-cpp-dev libzstd1 libzstd-dev zlib1g zlib1g-dev \
    nlohmann-json3-dev libcli11-dev libnanoflann-dev libpugixml1v5 libpugixml-dev catch2)
  for package in "$folder"/deb/*.deb; do dpkg -x "$package" "$folder/part"; done
  # The CMake files of CLBlast contain the absolute path of a library.
  sed -i "s#/usr/lib/$triple/lib#$system/usr/lib/$triple/lib#g" "$folder/part/usr/lib/$triple/cmake/CLBlast/"*
  mv "$folder/part" "$system"
fi
build=$folder/$target
case $target in
  arm64)
    cmake -G Ninja -S "$root" -B "$build" -DCMAKE_BUILD_TYPE=Release -DCMAKE_TOOLCHAIN_FILE="$root/cmake/arm64.cmake" \
      -Darm64_root="$system" -DUBS_OPENCV=OFF -DUBS_CUDA=OFF
    cmake --build "$build" --target ubs ubs_shared test_oracle test_registry test_packed test_pipeline
    run() {
      qemu-aarch64-static -L "/usr/$triple" -E LD_LIBRARY_PATH="$system/usr/lib/$triple:$system/lib/$triple" "$@"
    }
    file "$build/ubs" "$build/libubs.so.0.2.0"
    run "$build/ubs" --version
    run "$build/ubs" synth glossy --size 32 --views 2 --test-views 1 --supersampling 1 --out "$folder/scene"
    for test in test_oracle test_registry test_packed; do run "$build/tests/$test"; done
    run "$build/tests/test_pipeline" --cuda-on-host "arrays of a renderer*"
    ;;
  windows)
    mkdir -p "$folder/headers"
    (cd "$system/usr/include" &&
      cp -r fmt nlohmann yaml-cpp catch2 nanoflann.hpp zlib.h zconf.h "$folder/headers")
    cmake -G Ninja -S "$root/tests/windows" -B "$build" -DCMAKE_BUILD_TYPE=Release \
      -DCMAKE_TOOLCHAIN_FILE="$root/cmake/mingw64.cmake" -DHEADERS="$folder/headers"
    cmake --build "$build"
    WINEPREFIX=$folder/wine WINEDEBUG=-all ctest --test-dir "$build" --output-on-failure
    ;;
  *)
    echo "$usage" >&2
    exit 2
    ;;
esac
