#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Collects the small libraries for a build without OpenCV and OpenCL from the Debian packages of this machine
# (tools/setup.sh lists them). Use them on a machine that has only a compiler, CMake and the CUDA toolkit:
#   tools/make_bundle.sh DIR
#   cmake -S . -B build -DUBS_OPENCV=OFF -DUBS_OPENCL=OFF -DUBS_BUNDLE=DIR      # on the other machine
set -eu
out=${1:?usage: make_bundle.sh DIR}
mkdir -p "$out/include" "$out/lib"
for header in fmt CLI nlohmann nanoflann.hpp pugixml.hpp pugiconfig.hpp yaml-cpp zlib.h zconf.h zstd.h zstd_errors.h; do
  cp -rL "/usr/include/$header" "$out/include/"
done
# These static libraries need the C++ library of this machine. The C++ library of the other machine must not be
# older.
for archive in libyaml-cpp.a libpugixml.a libz.a libzstd.a; do
  found=$(find /usr/lib /usr/lib64 -name "$archive" 2>/dev/null | head -1)
  [ -n "$found" ] || { echo "make_bundle.sh: $archive is not installed (tools/setup.sh lists the packages)" >&2; exit 1; }
  cp -L "$found" "$out/lib/"
done
du -sh "$out"
