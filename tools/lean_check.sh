#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Builds the program as a bare machine would (no OpenCV, no OpenCL, libraries from a bundle) in a new folder, and
# checks that it runs, what it links, and that it says what it cannot do. Minutes; by hand, not in ctest.
#   tools/lean_check.sh FOLDER [CMake option ...]
# A bundle that is there already (FOLDER/bundle, of tools/make_bundle.sh) is taken as it is: on a bare machine it cannot
# be made.
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
  echo "lean_check.sh: linked with what a bare machine has not" >&2
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
