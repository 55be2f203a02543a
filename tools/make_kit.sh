#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes a kit for a machine that has little more than a GPU: the executable and device tests of a lean build
# (no OpenCV, one architecture), the libraries that they need, gpu_check.sh and the packed data, in one
# archive of at most 60 MiB.
#   tools/make_kit.sh OUT.tar.xz|OUT.tar.gz DATA.ubsd [BUILD_FOLDER] [CMake option ...]
# On the other machine: tar xf OUT.tar.xz && kit/bin/gpu_check.sh RESULTS kit/DATA.ubsd
# A minimal installation of Debian or Ubuntu can unpack .tar.gz, but has no xz.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
usage="usage: make_kit.sh OUT.tar.xz|OUT.tar.gz DATA.ubsd [BUILD_FOLDER] [CMake option ...]"
out=${1:?$usage} data=${2:?$usage} build=${3:-$root/build-kit}
case $out in
  *.tar.xz) compress="xz -9 -T1" ;;
  *.tar.gz) compress="gzip -9" ;;
  *) echo "$usage" >&2; exit 2 ;;
esac
[ -r "$data" ] || { echo "make_kit.sh: $data: no such file; make it with 'ubs pack LEGO --out $data'" >&2; exit 3; }
if [ $# -gt 3 ]; then shift 3; else set --; fi
cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DUBS_OPENCV=OFF -DUBS_MPI=OFF \
  -DCMAKE_CUDA_ARCHITECTURES=90 "$@"
cmake --build "$build"
work=$(mktemp -d)
trap 'rm -rf "$work" "$out.part"' EXIT
cmake --install "$build" --component portable --strip --prefix "$work/kit"
cp "$data" "$work/kit/"
tar -C "$work" -c kit | $compress >"$out.part"
size=$(wc -c <"$out.part")
if [ "$size" -gt $((60 << 20)) ]; then
  echo "make_kit.sh: the kit has $size bytes, more than 60 MiB: pack fewer or smaller views" >&2
  exit 1
fi
mv "$out.part" "$out"
echo "$out: $size bytes"
