#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Gathers the small libraries that a build without OpenCV and OpenCL needs from this machine's Debian packages
# (tools/setup.sh lists them), for a machine that has a compiler, CMake and the CUDA toolkit alone:
#   tools/make_bundle.sh DIR
#   cmake -S . -B build -DUBS_OPENCV=OFF -DUBS_OPENCL=OFF -DUBS_BUNDLE=DIR      # there
set -eu
out=${1:?usage: make_bundle.sh DIR}
mkdir -p "$out/include" "$out/lib"
for header in fmt CLI nlohmann nanoflann.hpp yaml-cpp zlib.h zconf.h zstd.h zstd_errors.h; do
  cp -rL "/usr/include/$header" "$out/include/"
done
# Archives are as old as the packages: the other machine's C++ library must be as new as this one's.
for archive in libyaml-cpp.a libz.a libzstd.a; do
  found=$(find /usr/lib /usr/lib64 -name "$archive" 2>/dev/null | head -1)
  [ -n "$found" ] || { echo "make_bundle.sh: $archive is not installed (tools/setup.sh lists the packages)" >&2; exit 1; }
  cp -L "$found" "$out/lib/"
done
du -sh "$out"
