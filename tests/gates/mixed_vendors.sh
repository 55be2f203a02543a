#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains a model with two MPI ranks, one on PoCL and one on another driver. Each rank has half of the splats. The
# training is run twice, and the two models must be bit-identical:
#   tests/gates/mixed_vendors.sh TOOLS DRIVER UBS MPIEXEC [FLAG...]
# DRIVER is `intel` (Intel's runtime for CPUs) or `rusticl` (Mesa's llvmpipe). If the driver or PoCL is missing, the
# script prints a message and exits with 77.
set -euo pipefail
tools=$1 driver=$2 ubs=$3
shift 3
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/icd"
for icd in /etc/OpenCL/vendors/pocl.icd "$tools/icd/$driver/$driver.icd"; do
  [ -e "$icd" ] || { echo "SKIPPED: $icd is missing; run tools/setup.sh gates; for Intel, set UBS_GATES=intel"; exit 77; }
  cp "$icd" "$folder/icd"
done
# With two threads, PoCL uses the same kernels as the other tests on the CI machine. These kernels are already in the
# cache.
export OCL_ICD_VENDORS=$folder/icd RUSTICL_ENABLE=llvmpipe POCL_MAX_PTHREAD_COUNT=2
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
other=llvmpipe
[ "$driver" = rusticl ] && export UBS_CHECK=off  # skips the device check, which gate_rusticl_check runs
if [ "$driver" = intel ]; then
  export LD_PRELOAD=$tools/venv/lib/libtbb.so.12 DPCPP_CPU_NUM_CUS=1
  # The device is selected by its index, because the name of PoCL's device also contains "Intel".
  other=$("$ubs" devices | sed -n 's/^[* ]*\([0-9]*\) .*(opencl, Intel(R) OpenCL.*/\1/p')
fi
cd "$folder"
"$ubs" synth glossy --out data --size 32 --views 8 --test-views 2 --supersampling 1
for run in a b; do
  timeout 600 "$@" -n 2 "$ubs" train data --dim 3 --batch 4 --init-points 300 --cap-max 400 --iterations 60 \
    --quiet --device "pthread,$other" --out $run 2>$run.txt || { cat $run.txt; exit 1; }
  grep "2 kinds of devices" $run.txt
done
cmp a/model.ply b/model.ply
