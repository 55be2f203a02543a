#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Runs a command on an OpenCL implementation that is installed in the build folder (tests/gates/README.md):
#   tests/gates/on_driver.sh [long] DRIVER TOOLS COMMAND...
# DRIVER is `races` or `uninitialised` (both are Oclgrind), `rusticl` (Mesa with llvmpipe), or `intel` (Intel's runtime
# for CPUs). TOOLS is the folder into which tools/setup.sh installs the implementations. If the implementation is
# missing, the script prints a message and exits with 77. If the first argument is `long`, it also does so unless the
# environment variable UBS_GATES is `all`.
set -euo pipefail

if [ "$1" = long ]; then
  shift
  if [ "${UBS_GATES:-}" != all ]; then
    echo "SKIPPED: this gate takes minutes and runs only with UBS_GATES=all"
    exit 77
  fi
fi
driver=$1 tools=$2
shift 2

missing() {
  echo "SKIPPED: $1 is missing; $2"
  exit 77
}

# Checks that Oclgrind detects the error in a kernel that contains a wrong statement. The arguments are a folder for
# files, an option of Oclgrind, a part of the expected message, and the wrong statement.
check_oclgrind() {
  printf '__kernel void wrong(__global int* to) { __local int l[2]; if (get_local_id(0) > 9) l[0] = 1; %s }\n' "$4" \
    >"$1/wrong.cl"
  printf '%s\nwrong\n2 1 1\n2 1 1\n<size=8 fill=0>\n' "$1/wrong.cl" >"$1/wrong.sim"
  oclgrind-kernel "$2" "$1/wrong.sim" 2>&1 | grep "$3" >/dev/null ||
    { echo "FAILED: oclgrind $2 does not detect the error in $4"; exit 1; }
}

# Runs a command on Oclgrind. The arguments are an option of Oclgrind, the options for its compiler, and the command.
# Functions are not inlined, because Oclgrind does not support two constructs that clang generates for inlined
# functions: the instruction `freeze` (with -O0), and scopes (with -O2).
on_oclgrind() {
  local option=$1 compiler=$2
  shift 2
  command -v oclgrind >/dev/null || missing oclgrind "run tools/setup.sh gates"
  folder=$(mktemp -d)
  trap 'rm -rf "$folder"' EXIT
  check_oclgrind "$folder" --data-races "data race" 'to[0] = get_local_id(0);'
  check_oclgrind "$folder" --uninitialized "ninitialized" 'to[get_local_id(0)] = l[0];'
  oclgrind "$option" --max-errors 100 --log "$folder/log" --build-options "$compiler" "$@"
  if [ -s "$folder/log" ]; then
    cat "$folder/log"
    echo "FAILED: Oclgrind reports the errors above"
    exit 1
  fi
}

export OCL_ICD_VENDORS=$tools/icd/$driver
case $driver in
  races) on_oclgrind --data-races "-O2 -fno-inline -Dalways_inline=noinline" "$@" ;;
  uninitialised) on_oclgrind --uninitialized "-cl-opt-disable -Dalways_inline=noinline" "$@" ;;
  rusticl)
    [ -d "$OCL_ICD_VENDORS" ] || missing "Mesa's rusticl" "run tools/setup.sh gates"
    export RUSTICL_ENABLE=llvmpipe
    "$@" ;;
  intel)
    [ -d "$OCL_ICD_VENDORS" ] || missing "Intel's runtime for CPUs" "run UBS_GATES=intel tools/setup.sh gates (840 MB)"
    # Intel's runtime needs the TBB library that is installed with it, which is newer than the one that OpenCV needs.
    LD_PRELOAD=$tools/venv/lib/libtbb.so.12 "$@" ;;
  *)
    echo "unknown driver: $driver: expected races, uninitialised, rusticl or intel" >&2
    exit 2 ;;
esac
