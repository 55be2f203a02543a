#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Installs missing packages, builds, and runs the demo or the tests. UBS_PRESET selects another CMake preset
# than `release` (see CMakePresets.json).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

preset=${UBS_PRESET:-release}
cuda=AUTO
case $preset in
  release) build=build ;;
  *) build=build-$preset ;;
esac

packages=(
  g++ cmake ninja-build
  opencl-headers ocl-icd-opencl-dev pocl-opencl-icd          # OpenCL, and a driver for the CPU
  libclblast-dev
  libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev
  libopencv-features2d-dev libopencv-calib3d-dev
  # decoders of image files that report damage as errors, and do not change pixels
  libturbojpeg0-dev libpng-dev libtiff-dev libopenexr-dev
  libavformat-dev libavcodec-dev libavutil-dev libswscale-dev # videos
  libyaml-cpp-dev zlib1g-dev libzstd-dev pkg-config libcli11-dev libfmt-dev nlohmann-json3-dev libnanoflann-dev libpugixml-dev catch2
  libjs-chart.js                                             # charts of ubs report
  libcpp-httplib-dev                                         # ubs view, ubs train --serve
  help2man                                                   # manual pages; optional
  libopenmpi-dev openmpi-bin                                 # several processes for one training run; optional
  # pip install . in a new environment (docs/python.md)
  python3-venv
  python3-yaml                                               # tools/experiment.py
)
# For the tests of the Python package
test_packages=(python3-numpy python3-pil python3-pytest python3-torch python3-matplotlib mypy)
pypi_packages=(jax pytest usd-core pycolmap)  # not in Debian; they are installed into a folder of the build

# Tools for tests of other drivers and GPUs on machines that do not have them (tests/gates/README.md). Without these
# tools, the tests are skipped.
gate_packages=(clang-15 oclgrind rocm-device-libs libclc-15
  chromium-headless-shell assimp-utils)                       # pages of ubs web, 96 MB; a reader of glTF
# Two drivers, 19 MB and 100 MB, for these tests only. They are unpacked into the build folder and not
# installed, so that other programs do not find additional devices.
gate_drivers=(mesa-opencl-icd intel-opencl-icd)

usage() {
  cat <<TEXT
usage: tools/setup.sh demo|test|build|gates
  demo   build, write two built-in scenes and train on them; the results are in out/demo
  test   build and run all tests
  build  build only: $build/ubs
  gates  only fetch the tools of the gates and packages from PyPI for tests (tests/gates/README.md), as test does;
         with UBS_GATES=intel or all, also fetch 840 MB of Intel's runtime for CPUs; with UBS_GATES=off, fetch nothing
Missing Debian packages are installed first (as root or with sudo).
TEXT
}

installed() { [ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]; }

# install_packages PACKAGE...: installs the packages that are missing.
install_packages() {
  if ! command -v dpkg-query >/dev/null; then
    echo "Not a Debian system: the libraries must be installed already (tools/setup.sh lists the packages)."
    return
  fi
  local missing=() root=() package
  for package in "$@"; do installed "$package" || missing+=("$package"); done
  [ ${#missing[@]} -eq 0 ] && return
  if [ "$(id -u)" -ne 0 ]; then
    root=(sudo)
    if ! command -v sudo >/dev/null || { [ ! -t 0 ] && ! sudo -n true 2>/dev/null; }; then
      echo "Missing packages. Install them with this line, then run the command again:"
      echo "sudo apt-get update && sudo apt-get install -y --no-install-recommends ${missing[*]}"
      exit 1
    fi
  fi
  echo "Installing: ${missing[*]}"
  "${root[@]}" apt-get update
  "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}"
}

# build [target ...]: builds everything if no target is named.
build() {
  cmake --preset "$preset" -DUBS_CUDA="$cuda" >"configure-$preset.log" 2>&1 || {
    cat "configure-$preset.log"
    exit 1
  }
  rm -f "configure-$preset.log"
  cmake --build --preset "$preset" ${1:+--target "$@"}
}

demo() {
  # Compiling CUDA for every architecture takes a minute, and is useless without an NVIDIA device.
  [ -e /dev/nvidiactl ] || cuda=OFF
  build ubs
  local ubs=$build/ubs out=out/demo
  "$ubs" synth glossy --size 200 --out $out/data --overwrite
  "$ubs" train --data $out/data --out $out/run --spec data_specs/demo.yaml --overwrite
  "$ubs" report $out/run --out $out/report.html --overwrite
  "$ubs" synth orbit --size 160 --views 80 --supersampling 2 --out $out/moving-data --overwrite
  "$ubs" train --data $out/moving-data --out $out/moving --spec data_specs/demo.yaml --dim 4 --iterations 1500 --overwrite
  "$ubs" web $out/moving $out/moving-data --out $out/moving.html --title "A model with time" --overwrite
  cat <<TEXT

model         $out/run/model.ply
metrics       $out/run/metrics.json
page          $out/report.html (with an interactive model)
dynamic scene $out/moving.html (press Play)
side by side  $out/run/renders/*.png (ground truth | render)
TEXT
}

# If a tool cannot be fetched, this is not an error: the gates that need it are skipped with a message.
fetch_gates() {
  [ "${UBS_GATES:-}" = off ] && return
  # Some package names contain a version, which differs between releases. apt installs nothing if one of the names
  # is unknown.
  local known
  mapfile -t known < <(apt-cache show "${gate_packages[@]}" 2>/dev/null | sed -n 's/^Package: //p' | sort -u)
  [ ${#known[@]} -eq ${#gate_packages[@]} ] ||
    echo "of the packages ${gate_packages[*]}, apt only knows ${known[*]}: for the others, run apt-get update, or use another release"
  (install_packages "${known[@]}") || echo "Tools of gates could not be installed."
  # These functions run in separate processes, because set -e has no effect in a function that is followed by `||`.
  bash tools/setup.sh fetch-drivers || echo "Mesa's rusticl and Intel's ocloc could not be fetched."
  bash tools/setup.sh fetch-pypi || echo "Tools of gates from PyPI could not be fetched."
}

fetch_drivers() {
  local root needed folder=$PWD/$build/gates driver
  root=$folder/root
  [ -d "$folder/icd/rusticl" ] && return
  mkdir -p "$folder/deb" "$root"
  (cd "$folder/deb" && apt-get -qq download "${gate_drivers[@]}")
  mapfile -t needed < <(apt-get install -s --no-install-recommends "${gate_drivers[@]}" |
    awk '$1 == "Inst" && $3 !~ /^\[/ { print $2 }' | grep -vxF "$(printf '%s\n' "${gate_drivers[@]}")")
  install_packages "${needed[@]}"
  for driver in "$folder"/deb/*.deb; do dpkg -x "$driver" "$root"; done
  rm -r "$folder/deb"
  list_driver rusticl "$root"/usr/lib/*/libRusticlOpenCL.so.1
}

# list_driver NAME LIBRARY: creates a folder with only this driver, for OCL_ICD_VENDORS.
list_driver() {
  [ -e "$2" ]
  mkdir -p "$build/gates/icd/$1"
  echo "$2" >"$build/gates/icd/$1/$1.icd"
}

fetch_pypi() {
  local venv=$PWD/$build/gates/venv wanted=(nvidia-cuda-nvdisasm) pip package
  [ -n "$(command -v nvcc ptxas /usr/local/cuda/bin/ptxas)" ] || wanted+=(nvidia-cuda-nvcc)
  case ${UBS_GATES:-} in intel | all) wanted+=(intel-opencl-rt intel-cmplr-lib-rt) ;; esac
  [ -d "$venv" ] || python3 -m venv "$venv"
  pip=("$venv/bin/pip" install --quiet --disable-pip-version-check --retries 1 --timeout 15)
  for package in "${pypi_packages[@]}"; do
    "${pip[@]}" "$package" || echo "$package could not be fetched from PyPI: its tests are skipped."
  done
  "${pip[@]}" "${wanted[@]}"
  [ ! -e "$venv/lib/libintelocl.so" ] || list_driver intel "$venv/lib/libintelocl.so"
}

# A successful run must include OpenCL tests: there must be a device and registered tests.
run_tests() {
  if [ ! -e /dev/nvidiactl ]; then  # one architecture is enough for tests without a GPU
    export CUDAARCHS=${CUDAARCHS:-90}
    echo "No NVIDIA device: CUDA code is only compiled for sm_$CUDAARCHS ('tools/setup.sh build': for all GPUs)."
  fi
  build
  "$build/ubs" devices
  # grep has no -q, because it must read to the end. Otherwise pipefail would report ctest's broken pipe.
  if ! ctest --test-dir "$build" -N -L pocl | grep 'Test *#' >/dev/null; then
    echo "No OpenCL test is registered."
    exit 1
  fi
  # One more job than processors, because some tests wait (for browsers, time-outs or rate limits).
  ctest --test-dir "$build" -j "$(($(nproc) + 1))" --no-tests=error --output-on-failure
}

case ${1:-} in
  demo) install_packages "${packages[@]}" && demo ;;
  test) install_packages "${packages[@]}" "${test_packages[@]}" && fetch_gates && run_tests ;;
  build) install_packages "${packages[@]}" && build ;;
  gates) fetch_gates ;;
  fetch-drivers) fetch_drivers ;;
  fetch-pypi) fetch_pypi ;;
  *)
    usage
    [ $# -eq 0 ] || exit 2
    ;;
esac
