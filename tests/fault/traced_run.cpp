// SPDX-License-Identifier: Apache-2.0
#include "tests/fault/traced_run.hpp"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <utility>

namespace ubs::test {
namespace {

namespace fs = std::filesystem;
using Word = unsigned long long;

// Names specifies which arguments of a system call identify its files. For `file`, `third_file` and
// `fifth_file`, one argument is a file descriptor (the first, third or fifth). For `path` and `second_path`,
// one argument is a path. For `at` and `second_at`, an argument is the descriptor of a folder, and the next
// one is a path relative to it. `paths` and `at_paths` stand for an old and a new name.
enum class Names { none, file, third_file, fifth_file, path, at, paths, at_paths, second_path, second_at };

struct Known {
  long number;
  const char* name;
  CallKind kind;
  Names names;
};

constexpr Known kKnown[] = {
    {SYS_open, "open", open_calls, Names::path},
    {SYS_creat, "creat", open_calls, Names::path},
    {SYS_openat, "openat", open_calls, Names::at},
    {SYS_openat2, "openat2", open_calls, Names::at},
    {SYS_write, "write", write_calls, Names::file},
    {SYS_writev, "writev", write_calls, Names::file},
    {SYS_pwrite64, "pwrite64", write_calls, Names::file},
    {SYS_pwritev, "pwritev", write_calls, Names::file},
    {SYS_pwritev2, "pwritev2", write_calls, Names::file},
    {SYS_sendfile, "sendfile", write_calls, Names::file},
    {SYS_copy_file_range, "copy_file_range", write_calls, Names::third_file},
    {SYS_splice, "splice", write_calls, Names::third_file},
    {SYS_mmap, "mmap", write_calls, Names::fifth_file},
    {SYS_fsync, "fsync", sync_calls, Names::file},
    {SYS_fdatasync, "fdatasync", sync_calls, Names::file},
    {SYS_syncfs, "syncfs", sync_calls, Names::file},
    {SYS_sync_file_range, "sync_file_range", sync_calls, Names::file},
    {SYS_sync, "sync", sync_calls, Names::none},
    {SYS_rename, "rename", rename_calls, Names::paths},
    {SYS_renameat, "renameat", rename_calls, Names::at_paths},
    {SYS_renameat2, "renameat2", rename_calls, Names::at_paths},
    {SYS_unlink, "unlink", remove_calls, Names::path},
    {SYS_unlinkat, "unlinkat", remove_calls, Names::at},
    {SYS_rmdir, "rmdir", remove_calls, Names::path},
    {SYS_mkdir, "mkdir", make_calls, Names::path},
    {SYS_mkdirat, "mkdirat", make_calls, Names::at},
    {SYS_link, "link", make_calls, Names::paths},
    {SYS_linkat, "linkat", make_calls, Names::at_paths},
    {SYS_symlink, "symlink", make_calls, Names::second_path},
    {SYS_symlinkat, "symlinkat", make_calls, Names::second_at},
    {SYS_truncate, "truncate", resize_calls, Names::path},
    {SYS_ftruncate, "ftruncate", resize_calls, Names::file},
    {SYS_fallocate, "fallocate", resize_calls, Names::file},
    {SYS_close, "close", close_calls, Names::file},
    {SYS_read, "read", read_calls, Names::file},
    {SYS_readv, "readv", read_calls, Names::file},
    {SYS_pread64, "pread64", read_calls, Names::file},
    {SYS_flock, "flock", lock_calls, Names::file},
};

// Returns a seccomp filter that makes the kernel stop a thread at those calls of the table whose kinds are in
// `seen`, and at no other call. When a program is loaded, it opens and maps thousands of files. The filter
// recognises private mappings by their flags, and does not stop at them. If `seen` does not contain
// look_calls, it also does not stop at calls of open and openat that open a file only for reading.
std::vector<sock_filter> filter(unsigned seen) {
  const auto statement = [](unsigned code, unsigned k) {
    return sock_filter{static_cast<unsigned short>(code), 0, 0, k};
  };
  const auto jump = [](unsigned condition, unsigned k, int if_true, int if_false) {
    return sock_filter{static_cast<unsigned short>(BPF_JMP | condition | BPF_K),
                       static_cast<unsigned char>(if_true), static_cast<unsigned char>(if_false), k};
  };
  const sock_filter trace = statement(BPF_RET | BPF_K, SECCOMP_RET_TRACE);
  const sock_filter allow = statement(BPF_RET | BPF_K, SECCOMP_RET_ALLOW);
  const auto argument = [&](int i) {  // lower half of argument i
    return statement(
        BPF_LD | BPF_W | BPF_ABS,
        static_cast<unsigned>(offsetof(seccomp_data, args) + sizeof(Word) * static_cast<unsigned>(i)));
  };
  std::vector<sock_filter> program{statement(BPF_LD | BPF_W | BPF_ABS, offsetof(seccomp_data, nr))};
  const auto when = [&](long number, const std::vector<sock_filter>& then) {
    program.push_back(jump(BPF_JEQ, static_cast<unsigned>(number), 0, static_cast<int>(then.size())));
    program.insert(program.end(), then.begin(), then.end());
  };
  for (const Known& known : kKnown) {
    const unsigned kinds = known.kind | (known.kind == open_calls ? unsigned{look_calls} : 0u);
    if ((kinds & seen) == 0) continue;
    const bool opens = known.number == SYS_open || known.number == SYS_openat;
    if (opens && (seen & look_calls) == 0)
      when(known.number, {argument(known.number == SYS_open ? 1 : 2),
                          jump(BPF_JSET, O_ACCMODE | O_CREAT | O_TRUNC, 0, 1), trace, allow});
    else if (known.number == SYS_mmap)
      when(known.number, {argument(3), statement(BPF_ALU | BPF_AND | BPF_K, MAP_TYPE),
                          jump(BPF_JEQ, MAP_PRIVATE, 1, 0), trace, allow});
    else
      when(known.number, {trace});
  }
  when(SYS_io_uring_setup, {statement(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | ENOSYS)});
  program.push_back(allow);
  return program;
}

constexpr int kCannotTrace = 125;

// Runs in the child process between fork and exec, so only system calls are allowed.
[[noreturn]] void become_traced(const sock_fprog& program, const char* script) {
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || ptrace(PTRACE_TRACEME, 0, 0, 0) != 0)
    _exit(kCannotTrace);
  raise(SIGSTOP);
  if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program, 0, 0) != 0) _exit(kCannotTrace);
  execl("/bin/sh", "sh", "-c", script, nullptr);
  _exit(kCannotTrace);
}

Word argument(const user_regs_struct& regs, int i) {
  const Word all[] = {regs.rdi, regs.rsi, regs.rdx, regs.r10, regs.r8, regs.r9};
  return all[i];
}

bool copy_out(pid_t thread, Word address, void* to, std::size_t bytes) {
  const iovec local{to, bytes}, remote{reinterpret_cast<void*>(address), bytes};
  return process_vm_readv(thread, &local, 1, &remote, 1, 0) == static_cast<ssize_t>(bytes);
}

std::string string_at(pid_t thread, Word address) {
  std::string text;
  for (char c = 0; copy_out(thread, address + text.size(), &c, 1) && c != 0;) text += c;
  return text;
}

std::string link_target(const std::string& link) {
  std::error_code error;
  return fs::read_symlink(link, error).string();
}

std::string file_path(pid_t thread, Word file) {
  return link_target(fmt::format("/proc/{}/fd/{}", thread, static_cast<int>(file)));
}

// Returns the absolute path of `name`, which may be relative to the folder. Resolves symbolic links in the
// path of the folder. If the last component is a link, it is not resolved, because rename and unlink change
// the link itself.
std::string full_path(pid_t thread, int folder, const std::string& name) {
  if (name.empty()) return "";
  fs::path path = name;
  if (path.is_relative())
    path = (folder == AT_FDCWD ? link_target(fmt::format("/proc/{}/cwd", thread))
                               : file_path(thread, static_cast<Word>(folder))) /
           path;
  path = path.lexically_normal();
  if (path.filename().empty()) path = path.parent_path();
  std::error_code error;
  const fs::path parent = fs::weakly_canonical(path.parent_path(), error);
  return (error ? path : parent / path.filename()).string();
}

std::pair<std::string, std::string> paths_of(pid_t thread, Names names, const user_regs_struct& regs) {
  const auto at = [&](int folder, int name) {
    return full_path(thread, folder < 0 ? AT_FDCWD : static_cast<int>(argument(regs, folder)),
                     string_at(thread, argument(regs, name)));
  };
  switch (names) {
    case Names::none:
      return {};
    case Names::file:
      return {file_path(thread, argument(regs, 0)), ""};
    case Names::third_file:
      return {file_path(thread, argument(regs, 2)), ""};
    case Names::fifth_file:
      return {file_path(thread, argument(regs, 4)), ""};
    case Names::path:
      return {at(-1, 0), ""};
    case Names::at:
      return {at(0, 1), ""};
    case Names::paths:
      return {at(-1, 0), at(-1, 1)};
    case Names::at_paths:
      return {at(0, 1), at(2, 3)};
    case Names::second_path:
      return {at(-1, 1), ""};
    case Names::second_at:
      return {at(1, 2), ""};
  }
  return {};
}

bool open_for_writing(pid_t thread, Word file) {
  std::ifstream info(fmt::format("/proc/{}/fdinfo/{}", thread, static_cast<int>(file)));
  for (std::string key, value; info >> key >> value;)
    if (key == "flags:") return (std::stoul(value, nullptr, 8) & O_ACCMODE) != O_RDONLY;
  return false;
}

bool writes(Word flags) { return (flags & O_ACCMODE) != O_RDONLY || (flags & (O_CREAT | O_TRUNC)) != 0; }

// Returns the kind of the call according to its arguments. Returns nothing if calls with these arguments are
// not recorded for any path.
std::optional<CallKind> kind_of(pid_t thread, const Known& known, const user_regs_struct& regs) {
  switch (known.number) {
    case SYS_open:
      return writes(regs.rsi) ? open_calls : look_calls;
    case SYS_openat:
      return writes(regs.rdx) ? open_calls : look_calls;
    case SYS_openat2: {  // struct open_how starts with the flags
      Word flags = 0;
      copy_out(thread, regs.rdx, &flags, sizeof flags);
      return writes(flags) ? open_calls : look_calls;
    }
    case SYS_mmap:
      if ((regs.rdx & PROT_WRITE) == 0 || (regs.r10 & MAP_TYPE) == MAP_PRIVATE ||
          static_cast<int>(regs.r8) < 0)
        return {};
      return write_calls;
    case SYS_close:
      if (!open_for_writing(thread, regs.rdi)) return {};
      return close_calls;
    default:
      return known.kind;
  }
}

// Changes the call so that it transfers only half of its bytes, or half of the first part if it has a vector.
void shorten(pid_t thread, user_regs_struct& regs) {
  if (regs.orig_rax == SYS_writev || regs.orig_rax == SYS_readv) {
    Word part[2] = {};
    copy_out(thread, regs.rsi, part, sizeof part);
    regs.orig_rax = regs.orig_rax == SYS_writev ? SYS_write : SYS_read;
    regs.rsi = part[0];
    regs.rdx = part[1];
    if (part[1] == 0) return;  // transferring 0 bytes of an empty first part is a correct result
  }
  regs.rdx = (regs.rdx + 1) / 2;
}

volatile std::sig_atomic_t alarm_rang = 0;

class Tracer {
 public:
  Tracer(const fs::path& watched, const std::optional<Fault>& fault) : fault_(fault) {
    folder_ = fs::weakly_canonical(watched).string();
    if (folder_.ends_with('/')) folder_.pop_back();
  }

  TracedRun run(const std::string& script, int limit_seconds, unsigned seen) {
    std::vector<sock_filter> instructions = filter(seen);
    const sock_fprog program{static_cast<unsigned short>(instructions.size()), instructions.data()};
    root_ = fork();
    if (root_ < 0) throw std::runtime_error("fork() failed, so the command was not started");
    if (root_ == 0) become_traced(program, script.c_str());
    int status = 0;
    waitpid(root_, &status, 0);
    if (WIFSTOPPED(status)) {
      ptrace(PTRACE_SETOPTIONS, root_, 0,
             PTRACE_O_EXITKILL | PTRACE_O_TRACESYSGOOD | PTRACE_O_TRACESECCOMP | PTRACE_O_TRACECLONE |
                 PTRACE_O_TRACEFORK | PTRACE_O_TRACEVFORK | PTRACE_O_TRACEEXEC);
      ptrace(PTRACE_CONT, root_, 0, 0);
      threads_.insert(root_);
      follow(limit_seconds);
    } else {
      ended(root_, status);
    }
    return std::move(run_);
  }

 private:
  void follow(int limit_seconds) {
    alarm_rang = 0;
    struct sigaction ring {
    }, before{};
    ring.sa_handler = [](int) { alarm_rang = 1; };
    sigaction(SIGALRM, &ring, &before);
    alarm(static_cast<unsigned>(limit_seconds));
    for (;;) {
      int status = 0;
      const pid_t thread = waitpid(-1, &status, __WALL);
      if (thread < 0 && errno == EINTR && alarm_rang != 0) {
        run_.hung = true;
        for (const pid_t each : threads_) kill(each, SIGKILL);
        continue;
      }
      if (thread < 0 && errno == EINTR) continue;
      if (thread < 0) break;  // no child is left
      if (WIFSTOPPED(status))
        stopped(thread, status);
      else
        ended(thread, status);
    }
    alarm(0);
    sigaction(SIGALRM, &before, nullptr);
  }

  void ended(pid_t thread, int status) {
    threads_.erase(thread);
    pending_.erase(thread);
    if (thread != root_) return;
    run_.code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    run_.signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
  }

  void stopped(pid_t thread, int status) {
    const bool is_new = threads_.insert(thread).second;
    const int signal = WSTOPSIG(status);
    if (status >> 8 == (SIGTRAP | (PTRACE_EVENT_SECCOMP << 8))) {
      entering(thread);
    } else if (signal == (SIGTRAP | 0x80)) {
      leaving(thread);
    } else if (status >> 16 != 0 || (is_new && signal == SIGSTOP)) {
      ptrace(PTRACE_CONT, thread, 0, 0);  // exec, a new thread, a new process
    } else {
      ptrace(PTRACE_CONT, thread, 0, signal);
    }
  }

  bool below(const std::string& path) const {
    return path.starts_with(folder_) && (path.size() == folder_.size() || path[folder_.size()] == '/');
  }

  std::string relative(const std::string& path) const {
    if (!below(path)) return path;
    return path.size() == folder_.size() ? "." : path.substr(folder_.size() + 1);
  }

  void entering(pid_t thread) {
    user_regs_struct regs{};
    ptrace(PTRACE_GETREGS, thread, 0, &regs);
    for (const Known& known : kKnown) {
      if (static_cast<long>(regs.orig_rax) != known.number) continue;
      const std::optional<CallKind> kind = kind_of(thread, known, regs);
      if (!kind) break;
      const auto [path, to] = paths_of(thread, known.names, regs);
      if (known.names != Names::none && !below(path) && !below(to)) break;
      run_.calls.push_back({*kind, known.name, relative(path), relative(to), 0});
      pending_[thread] = {run_.calls.size() - 1, false};
      if (strikes(*kind)) strike(thread, regs);
      ptrace(PTRACE_SYSCALL, thread, 0, 0);
      return;
    }
    ptrace(PTRACE_CONT, thread, 0, 0);
  }

  bool strikes(CallKind kind) {
    if (!fault_ || (fault_->kinds & kind) == 0) return false;
    ++counted_;
    return counted_ == fault_->nth || (counted_ > fault_->nth && fault_->lasting);
  }

  void strike(pid_t thread, user_regs_struct& regs) {
    run_.struck = true;
    switch (fault_->action) {
      case Fault::fail:
        regs.orig_rax = static_cast<Word>(-1);  // with this number, the kernel makes no call
        regs.rax = static_cast<Word>(-fault_->number);
        ptrace(PTRACE_SETREGS, thread, 0, &regs);
        break;
      case Fault::shorten:
        shorten(thread, regs);
        ptrace(PTRACE_SETREGS, thread, 0, &regs);
        break;
      case Fault::kill_before:
        kill(thread, SIGKILL);
        break;
      case Fault::kill_after:
        pending_[thread].kill_after = true;
        break;
      case Fault::signal:
        kill(root_, fault_->number);
        break;
    }
  }

  void leaving(pid_t thread) {
    const auto it = pending_.find(thread);
    if (it != pending_.end()) {
      user_regs_struct regs{};
      ptrace(PTRACE_GETREGS, thread, 0, &regs);
      run_.calls[it->second.call].result = static_cast<long>(regs.rax);
      if (it->second.kill_after) kill(thread, SIGKILL);
      pending_.erase(it);
    }
    ptrace(PTRACE_CONT, thread, 0, 0);
  }

  struct Pending {
    std::size_t call;
    bool kill_after;
  };

  std::optional<Fault> fault_;
  std::string folder_;
  pid_t root_ = 0;
  int counted_ = 0;
  std::set<pid_t> threads_;
  std::map<pid_t, Pending> pending_;
  TracedRun run_{};
};

}  // namespace

std::string to_text(const std::vector<Call>& calls) {
  std::string text;
  for (const Call& call : calls)
    text += fmt::format("{} {}{}{} = {}\n", call.name, call.path, call.to.empty() ? "" : " -> ", call.to,
                        call.result);
  return text;
}

int TracedRun::count(unsigned kinds) const {
  int number = 0;
  for (const Call& call : calls) number += (call.kind & kinds) != 0;
  return number;
}

bool can_trace() {
  static const bool can = [] {
    const TempFolder folder;
    const TracedRun run = trace_command(folder, "echo >file", folder.path());
    return run.code == 0 && run.count(open_calls) > 0;
  }();
  return can;
}

TracedRun trace_command(const TempFolder& folder, const std::string& command, const fs::path& watched,
                        const std::optional<Fault>& fault, int limit_seconds, unsigned seen) {
  const std::string script = fmt::format("cd {} && exec >stdout.txt 2>stderr.txt </dev/null; exec {}",
                                         quoted(folder.path()), command);
  TracedRun run = Tracer(watched, fault).run(script, limit_seconds, seen);
  run.out = get(folder / "stdout.txt");
  run.err = get(folder / "stderr.txt");
  return run;
}

}  // namespace ubs::test
