#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Two ranks, one on PoCL and one on Mesa's llvmpipe, train one model, each with half of the splats; twice the same bits:
#   tests/gates/mixed_vendors.sh TOOLS UBS MPIEXEC [FLAG...]
# Ends with 77, saying why, where one of the two drivers is missing.
set -euo pipefail
tools=$1 ubs=$2
shift 2
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/icd"
for driver in /etc/OpenCL/vendors/pocl.icd "$tools/icd/rusticl/rusticl.icd"; do
  [ -e "$driver" ] || { echo "SKIPPED: no $driver; run tools/setup.sh gates"; exit 77; }
  cp "$driver" "$folder/icd"
done
export OCL_ICD_VENDORS=$folder/icd RUSTICL_ENABLE=llvmpipe POCL_MAX_PTHREAD_COUNT=1
export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
cd "$folder"
"$ubs" synth glossy --out data --size 32 --views 8 --test-views 2 --supersampling 1
for run in a b; do
  timeout 300 "$@" -n 2 "$ubs" train data --dim 3 --batch 4 --init-points 300 --cap-max 400 --iterations 60 --no-plan \
    --quiet --device pthread,llvmpipe --out $run 2>$run.txt || { cat $run.txt; exit 1; }
  grep "2 kinds of devices" $run.txt
done
cmp a/model.ply b/model.ply
