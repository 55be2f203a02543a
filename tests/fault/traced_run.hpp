// SPDX-License-Identifier: Apache-2.0
// Test support: runs a command and records its system calls on the files in one folder. The n-th call can be
// made to fail or to transfer half of its bytes. The process can also be killed before or after this call, or
// receive a signal before it.
//
// The calls are intercepted by ptrace with a seccomp filter, at the boundary of the kernel. A preloaded
// library would miss internal calls of libc, libstdc++ and OpenCV (fwrite, ofstream, and rename in
// std::filesystem need not use the symbols that it replaces), and the compiler that PoCL starts. This method
// misses no call: threads and child processes are followed, io_uring is disabled, and shared writable
// mappings of files count as writes. Calls that are not in the table run at full speed. The method requires
// Linux on x86-64. If tracing is not permitted, can_trace() returns false.
//
//   const TracedRun clean = trace_ubs(folder, "pack data --out out/F.ubsd", folder / "out");
//   for (const Call& call : clean.calls) ...  // in their order: open, write, sync, rename, ...
//   Fault fault{.kinds = write_calls, .nth = 3, .action = Fault::fail, .number = ENOSPC};
//   const TracedRun full = trace_ubs(folder, "pack data --out out/F.ubsd", folder / "out", fault);
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/run_ubs.hpp"

namespace ubs::test {

// Each kind is one bit, so that a fault can apply to several kinds.
enum CallKind : unsigned {
  open_calls = 1,   // open for writing, or with creation of the file
  write_calls = 2,  // write, writev, pwrite, copy_file_range, ..., and shared writable mappings
  sync_calls = 4,   // fsync, fdatasync, syncfs, sync_file_range; also sync, although it has no file
  rename_calls = 8,
  remove_calls = 16,   // unlink, unlinkat, rmdir
  make_calls = 32,     // mkdir, link, symlink
  resize_calls = 64,   // truncate, ftruncate, fallocate
  close_calls = 128,   // close of files that were open for writing
  look_calls = 256,    // open for reading, including folders
  read_calls = 512,    // read, pread, readv
  lock_calls = 1024,   // flock
  change_calls = 127,  // all calls that change the content of the disk, and sync
  all_calls = 2047,
};

struct Call {
  CallKind kind;
  std::string name;      // name of the system call
  std::string path, to;  // relative to the folder if inside it; `to` is the new name of a rename or link
  // Value that the kernel returned, or -errno. It is 0 if the process was killed before the call.
  long result = 0;
};

std::string to_text(const std::vector<Call>& calls);

struct Fault {
  enum Action { fail, shorten, kill_before, kill_after, signal };

  unsigned kinds;  // bits of CallKind; calls of these kinds are counted together
  int nth;         // number of the call at which the fault happens, counted from 1
  Action action;
  // For `fail`, the value of errno. For `signal`, the number of the signal, which is sent to the process of
  // the command before the call. Not used for other actions.
  int number = 0;
  bool lasting = false;  // fail: all later calls of these kinds also fail, as on a disk that stays full
};

struct TracedRun {
  int code;     // exit code of the command; -1: it was ended by a signal
  int signal;   // signal that ended the command; 0: none
  bool hung;    // whether the command was killed after the time limit
  bool struck;  // whether the fault happened
  std::string out, err;
  std::vector<Call> calls;

  int count(unsigned kinds) const;
};

bool can_trace();

// Runs the shell command `command` in `folder`, and records its calls on files in the folder `watched`, which
// need not exist yet. Writes its output to stdout.txt and stderr.txt in `folder`. Waits for child processes
// that outlive the command. Kills all processes after `limit_seconds`. The actions kill_before and kill_after
// only kill the process that made the call. `seen` contains the kinds of calls that are recorded. A process
// starts faster if look_calls are excluded.
TracedRun trace_command(const TempFolder& folder, const std::string& command,
                        const std::filesystem::path& watched, const std::optional<Fault>& fault = {},
                        int limit_seconds = 120, unsigned seen = all_calls);

// Runs ubs or ubs-lab (program_of()) with these arguments, and records its calls like trace_command().
inline TracedRun trace_ubs(const TempFolder& folder, const std::string& arguments,
                           const std::filesystem::path& watched, const std::optional<Fault>& fault = {},
                           int limit_seconds = 120, unsigned seen = all_calls) {
  return trace_command(folder, fmt::format("'{}' {}", program_of(arguments), arguments), watched, fault,
                       limit_seconds, seen);
}

}  // namespace ubs::test
