#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Checks and measures ubs on a machine with a GPU, in two phases.
# The first phase takes less than two minutes on 16 cores and checks that the GPU computes correctly. It lists the
# devices, runs `ubs devices --check`, the tests with DEVICE and with OpenCL on the same GPU, and memory checks. It
# also trains twice for a short time to compare the results bit by bit, and once with OpenCL to compare the quality. The
# tests run in parallel; their complete logs are in OUT/right.tar.gz.
# The second phase measures: tuning, a short and a long training run, frames per second, times by stage, CUDA compared
# with OpenCL. All later steps use the result of `ubs-lab tune` (docs/tuning.md), except where a step says "untuned".
#   gpu_check.sh OUT DATA.ubsd [DEVICE, default cuda]
# GPU_CHECK_PHASE=right or fast runs one phase; both together take nine minutes.
# DATA: lego with a black background (ubs pack). The folder test_garden (docs/benchmarks.md) is looked for in
# the folder of DATA; GPU_CHECK_GARDEN names another place.
# If this script is in a portable folder (cmake --install BUILD --component portable), it runs the programs
# there. Otherwise it builds the project that it belongs to (needs nvcc and what tools/setup.sh installs).
# GPU_CHECK_SECONDS limits the total time (530 s). Each step has its own limit, which is longer if the total is
# more than 530 s, and the first steps leave time for the long training and the steps after it.
# To try the first phase without a GPU:
#   GPU_CHECK_PHASE=right GPU_CHECK_SECONDS=5300 gpu_check.sh OUT DATA.ubsd opencl:cpu
# OUT/summary.txt reports every step and ends with the measured goals (docs/cuda.md). The exit code is the
# number of failed steps.
set -u
out=${1:?usage: gpu_check.sh OUT DATA.ubsd [DEVICE]}
data=${2:?usage: gpu_check.sh OUT DATA.ubsd [DEVICE]}
device=${3:-cuda}
limit=${GPU_CHECK_SECONDS:-530}
scale=$(((limit + 529) / 530))
phase=${GPU_CHECK_PHASE:-both}
case $phase in right | fast | both) ;; *) echo "gpu_check.sh: GPU_CHECK_PHASE must be right, fast or both, not '$phase'" >&2; exit 2 ;; esac
iterations=${GPU_CHECK_ITERATIONS:-30000}
garden=${GPU_CHECK_GARDEN:-$(dirname "$data")/test_garden}
here=$(cd "$(dirname "$0")" && pwd)
[ -r "$data" ] || { echo "gpu_check.sh: $data: no such file; make it with 'ubs pack LEGO --out $data'" >&2; exit 3; }
mkdir -p "$out" && out=$(cd "$out" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export UBS_KERNEL_CACHE=$work/kernels  # so that this run compiles all kernels itself
export UBS_TUNING_DIR=$work/tuning UBS_TUNING=on  # so that earlier tuning has no effect on this run
summary=$out/summary.txt logs=$out/logs.txt
: >"$summary" && : >"$logs"
reserve=$((limit * 55 / 100))  # seconds reserved for later steps

left() { echo $((limit - reserve - SECONDS)); }
failed() { grep -c '^.\{28\} FAILED' "$summary"; }
# verdict NAME EXIT_CODE SECONDS LIMIT LAST_LINE: adds a line to the summary.
verdict() {
  case $2 in
    0) printf '%-28s ok      %4d s  %s\n' "$1" "$3" "$5" ;;
    77) printf '%-28s SKIPPED          %s\n' "$1" "$5" ;;
    124 | 137) printf '%-28s FAILED: not done in %d s  %s\n' "$1" "$4" "$5" ;;
    *) printf '%-28s FAILED %3d %3d s  %s\n' "$1" "$2" "$3" "$5" ;;
  esac >>"$summary"
}
# step NAME MOST_SECONDS COMMAND...: runs a command. Its last line, or the test quality of a training run, goes to the
# summary, and its output (at most 400 kB) to the logs.
step() {
  local name=$1 most=$(($2 * scale)) start=$SECONDS code
  shift 2
  [ "$most" -gt "$(left)" ] && most=$(left)
  if [ "$most" -lt 5 ]; then
    printf '%-28s not run: no time left\n' "$name" >>"$summary"
    return
  fi
  timeout -k 15 "$most" "$@" >"$work/log" 2>&1
  code=$?
  { echo "=== $name (exit code $code, $((SECONDS - start)) s): $*"; head -c 400000 "$work/log"; echo; } >>"$logs"
  local last
  last=$(grep '^test  ' "$work/log" | tail -1)  # if it was a training run
  [ -n "$last" ] || last=$(grep -v '^$' "$work/log" | tail -1)
  verdict "$name" $code $((SECONDS - start)) "$most" "$last"
  tail -1 "$summary"
}

# Writes the last line of the summary, prints the whole summary and exits with the exit code.
end() {
  local count
  count=$(failed)
  printf 'total %d s, %d failed\n' "$SECONDS" "$count" >>"$summary"
  cat "$summary"
  exit "$count"
}

# The executables are next to this script; otherwise they are built here.
if [ -x "$here/ubs" ] && "$here/ubs" --version >/dev/null 2>&1; then
  bin=$here tests=$here
  export UBS_TEST_SOURCE=$here/../source  # kernels and other files that tests read (cmake/Portable.cmake)
else
  source=$(cd "$here/.." && pwd)
  build() {
    cmake -S "$source" -B "$work/build" -G Ninja -DUBS_CUDA=ON -DCMAKE_CUDA_ARCHITECTURES=native &&
      ninja -C "$work/build" ubs ubs-lab test_stages test_pipeline test_packed test_metrics test_variants test_work \
        test_approximations test_reduce
  }
  export -f build
  export source work
  reserve=0
  step build 300 bash -c build
  reserve=$(((limit - SECONDS) * 55 / 100))
  bin=$work/build tests=$work/build/tests
  [ -x "$bin/ubs-lab" ] || { cat "$summary"; exit 1; }
fi
ubs=$bin/ubs lab=$bin/ubs-lab

# The OpenCL driver of the GPU needs an ICD file, which containers often lack.
if [ ! -e /etc/OpenCL/vendors/nvidia.icd ] && [ -z "${OCL_ICD_VENDORS:-}" ]; then
  library=$(ldconfig -p 2>/dev/null | awk '/libnvidia-opencl\.so\.1/ { print $NF; exit }')
  [ -n "$library" ] || library=$(find /usr/local/nvidia /usr/lib -name 'libnvidia-opencl.so.1' 2>/dev/null | head -1)
  if [ -n "$library" ]; then
    mkdir "$work/vendors" && echo "$library" >"$work/vendors/nvidia.icd"
    export OCL_ICD_VENDORS=$work/vendors
  fi
fi

step machine 20 bash -c 'uname -sr; nproc; nvidia-smi || echo "no nvidia-smi"'
step devices 20 "$ubs" devices
"$ubs" devices --json >"$out/devices.json" 2>/dev/null
has_opencl=$("$ubs" devices --device opencl:gpu >/dev/null 2>&1 && echo yes || echo no)

# Correctness is checked first. As many steps as there are processors run in parallel, because most of the
# time is spent on compiling. Tests with the tag [opencv] are excluded, because they need a build with OpenCV,
# and the build of tools/make_kit.sh has none.
# begin NAME MOST_SECONDS COMMAND...: starts a step in parallel to others; its log goes to the folder `right`.
begin() {
  while [ "$(jobs -rp | wc -l)" -ge "$(nproc)" ]; do wait -n; done
  local name=$1 most=$(($2 * scale)) start=$SECONDS
  shift 2
  [ "$most" -gt "$(left)" ] && most=$(left)
  if [ "$most" -lt 5 ]; then
    printf '%-28s not run: no time left\n' "$name" >>"$summary"
    return
  fi
  {
    timeout -k 15 "$most" "$@" >"$right/$name.log" 2>&1
    verdict "$name" $? $((SECONDS - start)) "$most" "$(grep -v '^$' "$right/$name.log" | tail -1)"
  } &
}
if [ "$phase" != fast ]; then
  right=$work/right && mkdir "$right"
  views=("$device")
  [ "$has_opencl" = yes ] && views+=(opencl:gpu)
  begin packed 20 "$tests/test_packed"
  for view in "${views[@]}"; do
    begin "check $view" 150 "$ubs" devices --check --device "$view"
    # NVIDIA's compiler takes minutes for the kernels for CPUs, which are not used on a GPU.
    begin "stages $view" 150 "$tests/test_stages" --device "$view" --optional "~every vector width*" "~cards with small*"
    for suite in pipeline variants reduce; do
      begin "$suite $view" 150 "$tests/test_$suite" --device "$view" --optional "~[opencv]"
    done
  done
  for suite in metrics work approximations; do
    begin "$suite $device" 150 "$tests/test_$suite" --device "$device" --optional "~[opencv]"
  done
  if command -v compute-sanitizer >/dev/null; then
    for tool in memcheck racecheck initcheck synccheck; do
      begin "$tool" 110 compute-sanitizer --tool $tool --error-exitcode 9 "$tests/test_pipeline" --device "$device" \
        --optional "image sizes*"
    done
  fi
  wait
  tar -C "$work" -czf "$out/right.tar.gz" right  # a bare machine may have no xz
  cat "$summary"
fi

# A short training run is repeated, to check that it learns and is reproducible bit by bit. It also runs once with
# OpenCL, which must reach a similar quality. The two back ends round differently, so their results are not identical,
# but the test PSNRs must differ by less than 0.3 dB. On an H200 they were 20.06 and 20.10 dB
# (docs/results/2026-11-26-h200.md).
reserve=$((reserve * 4 / 5))
small=(--data "$data" --cap-max 50000 --init-points 20000 --save-renders 0 --overwrite)
briefly=${GPU_CHECK_SHORT:-500}  # iterations
short=("${small[@]}" --device "$device" --schedule published --iterations "$briefly")
step "train $briefly" 60 "$ubs" train "${short[@]}" --out "$work/first"
step "train $briefly again" 60 "$ubs" train "${short[@]}" --out "$work/second"
step "same bytes" 10 cmp "$work/first/model.ply" "$work/second/model.ply"
[ "$has_opencl" = yes ] && step "train $briefly, OpenCL" 60 "$ubs" train "${small[@]}" --device opencl:gpu \
  --schedule published --iterations "$briefly" --out "$work/opencl"
cp "$work/first/metrics.json" "$out/train_short.json" 2>/dev/null
cp "$work/opencl/metrics.json" "$out/train_short_opencl.json" 2>/dev/null
if [ -e "$work/first/metrics.json" ] && [ -e "$work/opencl/metrics.json" ]; then
  step "same quality with OpenCL" 10 awk -v bound=0.3 -v device="$device" '
    /^ *"test": {/ { test = 1 }
    test && /"psnr":/ { gsub(/[^-+.0-9e]/, "", $2); psnr[FILENAME] = $2; test = 0 }
    END {
      a = psnr[ARGV[1]]; b = psnr[ARGV[2]]; difference = a - b
      if (difference < 0) difference = -difference
      printf "test PSNR: %s %s dB, OpenCL %s dB; they must differ by less than %s dB\n", device, a, b, bound
      exit !(a != "" && b != "" && difference < bound)
    }' "$work/first/metrics.json" "$work/opencl/metrics.json"
fi
if [ "$phase" = right ]; then
  end
fi
step "tune $device" 55 "$lab" tune --device "$device" --size "800x800/${GPU_CHECK_SCENE:-300K}" --max-time 40 \
  --json "$out/tune.json" --overwrite
[ -e "$out/tune.json" ] && cp "$work/log" "$out/tune.txt"
case $device in
  cuda*)
    untuned=(env UBS_TUNING=off "$lab")
    step "train $briefly tuned" 60 "$ubs" train "${short[@]}" --out "$work/tuned"
    step "same bytes as untuned" 10 cmp "$work/first/model.ply" "$work/tuned/model.ply" ;;
esac
step "train $briefly of 3DGS" 45 "$ubs" train "${small[@]}" --device "$device" --schedule published --iterations "$briefly" --dim 3 --kernel gaussian --colour sh3 \
  --rot-mode quaternion --lr-opacity 0.02 --lr-scale 0.02 --out "$work/gaussian"

# The long training. If it runs out of time, it is interrupted and measured in that state.
reserve=$((limit * 20 / 100))
step "train $iterations" "$(left)" "$ubs" train --data "$data" --device "$device" --out "$work/long" \
  --schedule published --iterations "$iterations" --eval-every 30s --save-renders 2
cp "$work/long/metrics.json" "$out/train_long.json" 2>/dev/null
cp "$work/long/log.csv" "$out/train_long_log.csv" 2>/dev/null
model=$work/long/model.ply
[ -e "$model" ] || model=$work/first/model.ply
reserve=$((limit * 15 / 100))
step "quality, frames per second" 30 "$ubs" eval --model "$model" --data "$data" --device "$device" --fps-views 100 \
  --out "$out/eval_long.json" --overwrite

# The following steps measure times by stage, with both back ends on the GPU, for scenes of a fixed size and for the
# trained model.
devices=$device
[ "$has_opencl" = yes ] && devices=$device,opencl:gpu
scenes="$(printf '^[^.]*[.]synthetic[.]%s[.]' "${GPU_CHECK_SCENE:-300K}")"
with_garden=()
if [ -e "$garden" ]; then
  with_garden=(--garden "$garden")
  scenes="$scenes|[.]garden[.]"
fi
changed="raster_forward|raster_backward|forward_backward"
with_model=()
if [ -e "$model" ]; then
  with_model=(--model "$model" --data "$data" --set background=0,0,0)
  scenes="$scenes|^($changed)[.]model[.]"
fi
reserve=$((limit * 5 / 100))
bench=("$lab" bench --run "$scenes" --min-time 0.2 --max-time 0.5 "${with_garden[@]}" "${with_model[@]}")
step "bench $device" 75 "${bench[@]}" --device "$device" --json "$out/bench.json" --overwrite
case $device in
  cuda*)
    again="^($changed|iteration)[.](synthetic[.]${GPU_CHECK_SCENE:-300K}|garden|model)[.]"
    step "bench untuned" 40 "${untuned[@]}" bench --run "$again" --min-time 0.2 \
      --max-time 0.5 "${with_garden[@]}" "${with_model[@]}" --device "$device" --json "$out/bench_untuned.json" --overwrite ;;
esac
[ "$has_opencl" = yes ] && step "bench opencl:gpu" 60 "${bench[@]}" --device opencl:gpu --json "$out/bench_opencl.json" --overwrite
compare=("$lab" compare --devices "$devices" --model "$model" --data "$data")
step compare 45 "${compare[@]}" --repeat "${GPU_CHECK_REPEAT:-100}" --out "$work/compare"
cp "$work/compare/"compare.* "$out" 2>/dev/null
reserve=0
step "compare training runs" 45 "${compare[@]}" --repeat 3 --schedule published --train-iterations "$briefly" --cap-max 50000 \
  --init-points 20000 --out "$work/trained"
for file in "$work/trained/"compare.*; do
  [ -e "$file" ] && cp "$file" "$out/compare_training.${file##*.}"
done

# number FILE KEY: prints the first number with that name. bench_ms FILE CASE: prints the median of a case.
number() { sed -n "s/^ *\"$2\": \([-0-9.e+]*\),*$/\1/p" "$out/$1" 2>/dev/null | head -1; }
bench_ms() {
  awk -v name="\"name\": \"$2." 'index($0, name) { found = 1 } found && /"median_ms"/ {
    gsub(/[^0-9.e+-]/, "", $2); print $2; exit }' "$out/$1" 2>/dev/null
}
# Prints the values that tune has stored.
chosen() { sed -n '/"values": {/,/}/p' "$out/tune.json" 2>/dev/null | sed -n 's/^ *"\(UBS_[A-Z_]*\)": \([0-9]*\).*/\1=\2/p' | paste -sd ' '; }
peak() { number train_long.json peak_device_bytes | awk '{ printf "%.0f", $1 / 1048576 }'; }
goal() { printf '  %-58s %s\n' "$1" "${2:-not measured}"; }
{
  echo "goals, on the device '$device':"
  [ -e "$out/tune.json" ] && goal "constants that tune chose" "$(chosen | sed 's/^$/the defaults/')"
  goal "training, iterations ($iterations wanted)" "$(number train_long.json iterations)"
  goal "  seconds (goal for 30000: 100)" "$(number train_long.json seconds)"
  goal "  splats (goal: 300000)" "$(number train_long.json splats)"
  goal "  PSNR [dB] (goal at 800x800: 36.9)" "$(number eval_long.json psnr)"
  goal "  SSIM" "$(number eval_long.json ssim)"
  goal "  peak device memory [MiB]" "$(peak)"
  goal "rendering the trained model [frames/s] (goal at 800x800: 1500)" "$(number eval_long.json fps_wall)"
  goal "garden, forward and backward [ms] (goal: 1)" "$(bench_ms bench.json forward_backward.garden)"
  goal "iteration of a synthetic scene (800x800) [ms]" "$(bench_ms bench.json iteration.synthetic)"
  goal "  untuned" "$(bench_ms bench_untuned.json iteration.synthetic)"
  goal "  waiting for the size of lists" "$(bench_ms bench.json iteration_wait.synthetic)"
  goal "  not waiting" "$(bench_ms bench.json iteration_bound.synthetic)"
  for scene in synthetic garden model; do
    for stage in raster_forward raster_backward forward_backward; do
      goal "$scene, $stage [ms]" "$(bench_ms bench.json $stage.$scene)"
      goal "  untuned" "$(bench_ms bench_untuned.json $stage.$scene)"
    done
  done
  goal "iteration by OpenCL on the same card (goal: within 25 %)" "$(bench_ms bench_opencl.json iteration.synthetic)"
} >>"$summary"
end
