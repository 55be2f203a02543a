#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Writes a table (CSV) with registers, spills, shared memory and occupancy of every CUDA kernel that is
# compiled ahead of time, for one architecture. Occupancy is the number of threads per multiprocessor that
# registers and shared memory allow, in percent of the maximum; it is computed for sm_80, sm_90 and sm_100.
# For kernels that are compiled at run time, test_cuda_programs writes such a table. Needs nvcc, but no GPU.
# Fails if compiling a kernel gives an error or a warning, or if a rasteriser spills registers.
#   tools/cuda_registers.sh OUT.csv [ARCHITECTURE, e.g. 90] [N ...]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
usage="usage: cuda_registers.sh OUT.csv [ARCHITECTURE] [N ...]"
out=${1:?$usage}
case $out in -*) echo "$usage" >&2; exit 2 ;; esac
architecture=${2:-90}
[ $# -ge 2 ] && shift 2 || shift 1
dims=${*:-3 4 6 7}
log=$(mktemp)
trap 'rm -f "$log" "$log.cubin"' EXIT

compile() { # compile SOURCE VARIANT_NAME [NVCC_OPTION ...]
  source=$1 variant=$2
  shift 2
  echo "variant $variant" >>"$log"
  nvcc -cubin -std=c++17 -I"$root" -Werror all-warnings -arch="sm_$architecture" -Xptxas -v "$@" \
    "$root/cuda_backend/$source.cu" -o "$log.cubin" >>"$log" 2>&1 || { cat "$log" >&2; exit 1; }
}
for source in raster_kernels loss_kernels list_kernels; do compile $source -; done
compile raster_kernels depth -DUBS_DEPTH=1
for n in $dims; do compile map_kernels "N=$n" -DUBS_N="$n"; done

demangle=cat
command -v c++filt >/dev/null && demangle=c++filt
awk '
  /^variant/ { variant = substr($0, 9) }
  /Compiling entry function/ { split($0, part, "\047"); name = part[2] }
  /bytes stack frame/ { stack = $1; stores = $5; loads = $9 }
  /Used [0-9]+ registers/ {
    registers = $0; sub(/.*Used /, "", registers); sub(/ .*/, "", registers)
    shared = 0; if (match($0, /[0-9]+ bytes smem/)) { shared = substr($0, RSTART, RLENGTH); sub(/ .*/, "", shared) }
    print name "|" variant "|" registers "|" stores "|" loads "|" stack "|" shared
  }' "$log" | $demangle | sed -E 's/ubs::cuda:://g; s/\(anonymous namespace\):://g; s/^void //; s/^([^|(]*)\([^|]*\)\|/\1|/' |
  awk -F'|' -v arch="sm_$architecture" '
    # Block sizes are those of cuda_backend/cuda_kernels.hpp. Registers are allocated to warps in units of
    # 256, and each block needs 1 KiB of shared memory in addition to its own.
    function occupancy(kernel, variant, registers, shared,    threads, blocks, most) {
      if (arch !~ /^sm_(80|90|100)$/) return ""
      threads = kernel ~ /^(raster_|measure_|sum_slots|loss_window|loss_gradient|write_|fit_|gather_|emit_|finish_)/ ? 256 : 128
      if (kernel ~ /^loss_total/) threads = 576
      if (kernel ~ /^raster_backward/ && variant ~ /^splats/) threads = 128
      most = 2048 / threads < 32 ? 2048 / threads : 32
      blocks = int(int(65536 / (256 * int((registers * 32 + 255) / 256))) / (threads / 32))
      if (blocks < most) most = blocks
      blocks = int((arch == "sm_80" ? 167936 : 233472) / (shared + 1024))
      if (blocks < most) most = blocks
      return int(100 * most * threads / 2048)
    }
    BEGIN {
      print "kernel,variant,architecture,registers,spill_store_bytes,spill_load_bytes,stack_bytes,shared_bytes,occupancy_percent"
    }
    { gsub(/, */, ";", $1)
      printf "%s,%s,%s,%s,%s,%s,%s,%s,%s\n", $1, $2, arch, $3, $4, $5, $6, $7, occupancy($1, $2, $3, $7)
      if ($1 ~ /^raster_/ && $4 + $5 > 0) bad = bad " " $1 }
    END { if (bad != "") { print "these rasterisers spill registers:" bad > "/dev/stderr"; exit 1 } }' >"$out"
column -s, -t "$out" 2>/dev/null || cat "$out"
