#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Everything that a machine with a GPU can show in one go, within nine minutes: device list, correctness suites (forms
# and switches that are compiled at run time among them), memory checks, determinism, float atomics, times by stage, a
# short and a long training. Writes one folder of small files.
#   gpu_check.sh OUT DATA.ubsd[.xz] [DEVICE, default cuda]
# Runs the portable folder it lies in (cmake --install BUILD --component portable), else builds the project that it
# lies in (needs nvcc and what tools/setup.sh installs). GPU_CHECK_SECONDS limits the whole.
# Every step is reported in OUT/summary.txt; the exit code is the number of steps that failed.
set -u
out=${1:?usage: gpu_check.sh OUT DATA.ubsd[.xz] [DEVICE]}
data=${2:?usage: gpu_check.sh OUT DATA.ubsd[.xz] [DEVICE]}
device=${3:-cuda}
limit=${GPU_CHECK_SECONDS:-530}
iterations=${GPU_CHECK_ITERATIONS:-30000}
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$out" && out=$(cd "$out" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export UBS_KERNEL_CACHE=$work/kernels  # what is compiled at run time is compiled in this run
summary=$out/summary.txt logs=$out/logs.txt
: >"$summary" && : >"$logs"
failed=0

left() { echo $((limit - SECONDS)); }
# step NAME MOST_SECONDS COMMAND...: its last line goes to the summary, all of its output to the logs.
step() {
  local name=$1 most=$2 start=$SECONDS code
  shift 2
  [ "$most" -gt "$(left)" ] && most=$(left)
  if [ "$most" -lt 5 ]; then
    printf '%-28s not run: no time left\n' "$name" >>"$summary"
    return
  fi
  timeout "$most" "$@" >"$work/log" 2>&1
  code=$?
  { echo "=== $name (exit code $code, $((SECONDS - start)) s): $*"; head -c 400000 "$work/log"; echo; } >>"$logs"
  case $code in
    0) printf '%-28s ok      %4d s  %s\n' "$name" $((SECONDS - start)) "$(grep -v '^$' "$work/log" | tail -1)" ;;
    77) printf '%-28s SKIPPED          %s\n' "$name" "$(tail -1 "$work/log")" ;;
    *) printf '%-28s FAILED %3d %3d s  %s\n' "$name" $code $((SECONDS - start)) "$(grep -v '^$' "$work/log" | tail -1)"
       failed=$((failed + 1)) ;;
  esac >>"$summary"
  tail -1 "$summary"
}

# The executables: beside this script, else built here.
if [ -x "$here/ubs" ] && "$here/ubs" --version >/dev/null 2>&1; then
  bin=$here tests=$here
else
  source=$(cd "$here/.." && pwd)
  build() {
    cmake -S "$source" -B "$work/build" -G Ninja -DUBS_CUDA=ON -DCMAKE_CUDA_ARCHITECTURES=native &&
      ninja -C "$work/build" ubs test_stages test_pipeline test_packed test_metrics test_variants test_work \
        test_approximations test_reduce
  }
  export -f build
  export source work
  step build 300 bash -c build
  bin=$work/build tests=$work/build/tests
  [ -x "$bin/ubs" ] || { cat "$summary"; exit 1; }
fi
ubs=$bin/ubs

# The card's OpenCL view needs an ICD file, which containers often lack.
if [ ! -e /etc/OpenCL/vendors/nvidia.icd ] && [ -z "${OCL_ICD_VENDORS:-}" ]; then
  library=$(ldconfig -p 2>/dev/null | awk '/libnvidia-opencl\.so\.1/ { print $NF; exit }')
  [ -n "$library" ] || library=$(find /usr/local/nvidia /usr/lib -name 'libnvidia-opencl.so.1' 2>/dev/null | head -1)
  if [ -n "$library" ]; then
    mkdir "$work/vendors" && echo "$library" >"$work/vendors/nvidia.icd"
    export OCL_ICD_VENDORS=$work/vendors
  fi
fi

case $data in
  *.xz) xz -dc "$data" >"$work/data.ubsd" && data=$work/data.ubsd ;;
esac

step machine 20 bash -c 'uname -sr; nproc; nvidia-smi || echo "no nvidia-smi"'
step devices 20 "$ubs" devices
"$ubs" devices --json >"$out/devices.json" 2>/dev/null
has_opencl=$("$ubs" devices --device opencl:gpu >/dev/null 2>&1 && echo yes || echo no)

# Correctness first.
step packed 20 "$tests/test_packed"
step "stages $device" 90 "$tests/test_stages" --device "$device" --optional
step "oracle $device" 60 "$tests/test_pipeline" --device "$device" --optional
step "metrics $device" 30 "$tests/test_metrics" --device "$device" --optional
step "variants $device" 75 "$tests/test_variants" --device "$device" --optional  # 25 forms, by NVRTC on CUDA
step "variants, kept programs" 30 "$tests/test_variants" --device "$device" --optional
step "work switches $device" 45 "$tests/test_work" --device "$device" --optional
step "approximations $device" 25 "$tests/test_approximations" --device "$device" --optional
step "weights of splats $device" 25 "$tests/test_reduce" --device "$device" --optional
if command -v compute-sanitizer >/dev/null; then
  for tool in memcheck racecheck initcheck synccheck; do
    step "$tool" 25 compute-sanitizer --tool $tool --error-exitcode 9 "$tests/test_pipeline" --device "$device" \
      --optional "image sizes*"
  done
fi
if [ "$has_opencl" = yes ]; then
  step "oracle opencl:gpu" 60 "$tests/test_pipeline" --device opencl:gpu
fi

# A short training, twice: it learns, and it repeats bit for bit.
small=(--data "$data" --device "$device" --cap-max 50000 --init-points 20000 --save-renders 0 --overwrite)
short=("${small[@]}" --iterations 1500)
step "train 1500" 90 "$ubs" train "${short[@]}" --out "$work/first"
step "train 1500 again" 90 "$ubs" train "${short[@]}" --out "$work/second"
step "same bytes" 10 cmp "$work/first/model.ply" "$work/second/model.ply"
case $device in
  cuda*) step "train 1500 with atomics" 60 "$ubs" train "${short[@]}" --atomics --out "$work/atomics" ;;
esac
step "train 500 of 3DGS" 45 "$ubs" train "${small[@]}" --iterations 500 --dim 3 --kernel gaussian --colour sh3 \
  --rot-mode quaternion --lr-opacity 0.02 --lr-scale 0.02 --out "$work/gaussian"
step "quality" 20 "$ubs" eval --model "$work/first/model.ply" --data "$data" --device "$device"

# The long one, then times by stage of its model, on both views of the card.
step "train $iterations" $(($(left) - 60)) "$ubs" train --data "$data" --device "$device" --out "$work/long" \
  --iterations "$iterations" --eval-at-seconds 10,30,60,120 --save-renders 2
cp "$work/long/metrics.json" "$out/train_long.json" 2>/dev/null
cp "$work/long/log.csv" "$out/train_long_log.csv" 2>/dev/null
model=$work/long/model.ply
[ -e "$model" ] || model=$work/first/model.ply
devices=$device
[ "$has_opencl" = yes ] && devices=$device,opencl:gpu
step compare 60 "$ubs" compare --devices "$devices" --model "$model" --data "$data" --repeat "${GPU_CHECK_REPEAT:-100}" \
  --out "$work/compare"
cp "$work/compare/compare.json" "$work/compare/compare.md" "$out" 2>/dev/null
if "$ubs" --help | grep -q "^ *bench "; then
  step bench "$(left)" "$ubs" bench --device "$device"
fi

printf 'total %d s, %d failed\n' "$SECONDS" "$failed" >>"$summary"
cat "$summary"
exit "$failed"
