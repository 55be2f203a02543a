#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds the program in a new folder as for a minimal machine (no OpenCV, no OpenCL, libraries from a bundle).
# Checks that the program runs, that it links no library that a minimal machine lacks, and that `ubs pack` fails
# with a message about OpenCV, because it cannot read images. This takes minutes. Run it by hand, because it is
# not part of ctest.
#   tools/lean_check.sh FOLDER [CMake option ...]
# An existing bundle in FOLDER/bundle is used. Otherwise tools/make_bundle.sh makes one, which is not possible
# on a minimal machine.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
folder=${1:?usage: lean_check.sh FOLDER [CMake option ...]}
shift
mkdir -p "$folder" && folder=$(cd "$folder" && pwd)
[ -d "$folder/bundle" ] || "$root/tools/make_bundle.sh" "$folder/bundle"
cmake -S "$root" -B "$folder/build" -DUBS_OPENCV=OFF -DUBS_OPENCL=OFF -DUBS_CUDA=ON -DUBS_BUNDLE="$folder/bundle" "$@"
cmake --build "$folder/build" --parallel --target ubs
ubs=$folder/build/ubs
if ldd "$ubs" | grep -E "opencv|OpenCL|clblast|yaml|fmt|zstd|libz\."; then
  echo "lean_check.sh: linked with libraries that a minimal machine does not have" >&2
  exit 1
fi
"$ubs" --version
"$ubs" synth glossy --size 64 --out "$folder/scene"  # writes PNG files, reads none
if "$ubs" pack "$folder/scene" --out "$folder/scene.ubsd" 2>"$folder/error.txt"; then
  echo "lean_check.sh: images were read without OpenCV" >&2
  exit 1
fi
grep "without OpenCV" "$folder/error.txt"
cmake --install "$folder/build" --component portable --prefix "$folder/portable" >/dev/null
du -sh "$folder/portable"
