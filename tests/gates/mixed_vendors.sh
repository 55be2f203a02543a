#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Trains a model with two ranks, one on PoCL and one on another driver (intel: Intel's runtime for CPUs,
# rusticl: Mesa's llvmpipe). Each has half of the splats. The training is repeated, and must be bit-identical:
#   tests/gates/mixed_vendors.sh TOOLS DRIVER UBS MPIEXEC [FLAG...]
# If one of the two drivers is missing, the script prints a message and exits with 77.
set -euo pipefail
tools=$1 driver=$2 ubs=$3
shift 3
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/icd"
for icd in /etc/OpenCL/vendors/pocl.icd "$tools/icd/$driver/$driver.icd"; do
  [ -e "$icd" ] || { echo "SKIPPED: no $icd; run tools/setup.sh gates (Intel's: UBS_GATES=intel, 840 MB)"; exit 77; }
  cp "$icd" "$folder/icd"
done
# With two threads, PoCL uses the same kernels as the other tests on the CI machine, which are already in the
# cache.
export OCL_ICD_VENDORS=$folder/icd RUSTICL_ENABLE=llvmpipe POCL_MAX_PTHREAD_COUNT=2
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
other=llvmpipe
[ "$driver" = rusticl ] && export UBS_CHECK=off  # gate_rusticl_check tests it
if [ "$driver" = intel ]; then
  export LD_PRELOAD=$tools/venv/lib/libtbb.so.12 DPCPP_CPU_NUM_CUS=1
  other=$("$ubs" devices | sed -n 's/^[* ]*\([0-9]*\) .*(opencl, Intel(R) OpenCL.*/\1/p')  # the name of PoCL's device contains that of Intel
fi
cd "$folder"
"$ubs" synth glossy --out data --size 32 --views 8 --test-views 2 --supersampling 1
for run in a b; do
  timeout 600 "$@" -n 2 "$ubs" train data --dim 3 --batch 4 --init-points 300 --cap-max 400 --iterations 60 \
    --quiet --device "pthread,$other" --out $run 2>$run.txt || { cat $run.txt; exit 1; }
  grep "2 kinds of devices" $run.txt
done
cmp a/model.ply b/model.ply
