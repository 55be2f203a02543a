// SPDX-License-Identifier: Apache-2.0
#include "host/experiment/child_process.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <thread>

#include "host/base/error.hpp"

namespace ubs::experiment {
namespace {

constexpr std::chrono::milliseconds kPollInterval{50};

// Between fork and exec; only async-signal-safe calls. Handlers fall back to the default by themselves.
[[noreturn]] void become(char* const* arguments, int log, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(127);  // the parent died before the line above
  const int nothing = open("/dev/null", O_RDONLY);
  if (nothing < 0 || dup2(nothing, STDIN_FILENO) < 0 || dup2(log, STDOUT_FILENO) < 0 ||
      dup2(log, STDERR_FILENO) < 0)
    _exit(127);
  execv(arguments[0], arguments);
  _exit(127);
}

// Ends and collects the child unless it has been collected: no orphan stays when a poll throws.
class Collector {
 public:
  explicit Collector(pid_t child) : child_(child) {}
  ~Collector() {
    if (child_ <= 0) return;
    kill(child_, SIGKILL);
    waitpid(child_, nullptr, 0);
  }
  Collector(const Collector&) = delete;
  Collector& operator=(const Collector&) = delete;
  void release() { child_ = 0; }

 private:
  pid_t child_;
};

}  // namespace

ChildResult run_child(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                      const std::function<Request()>& poll) {
  std::vector<std::string> copies = arguments;
  std::vector<char*> pointers;
  for (std::string& argument : copies) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  const int file = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (file < 0) fail(ErrorKind::data, "{}: cannot write: {}", log.string(), std::strerror(errno));
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) become(pointers.data(), file, parent);
  close(file);
  if (child < 0) fail(ErrorKind::internal, "cannot start a process: {}", std::strerror(errno));
  Collector collector(child);
  bool interrupted = false;
  for (;;) {
    int status = 0;
    if (waitpid(child, &status, WNOHANG) == child) {
      collector.release();
      return WIFSIGNALED(status) ? ChildResult{0, WTERMSIG(status)} : ChildResult{WEXITSTATUS(status), 0};
    }
    const Request request = poll();
    if (request == Request::kill) kill(child, SIGKILL);
    if (request == Request::interrupt && !interrupted) kill(child, SIGINT);
    interrupted |= request == Request::interrupt;
    std::this_thread::sleep_for(kPollInterval);
  }
}

FolderLock::FolderLock(const std::filesystem::path& folder, double patience)
    : file_(open((folder / ".lock").c_str(), O_RDWR | O_CREAT, 0644)) {
  if (file_ < 0) fail(ErrorKind::data, "{}: cannot write: {}", folder.string(), std::strerror(errno));
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(patience);
  while (flock(file_, LOCK_EX | LOCK_NB) != 0) {
    if (std::chrono::steady_clock::now() >= end) {
      close(file_);
      fail(ErrorKind::usage, "{}: another process is writing there; wait for its end or choose another --out",
           folder.string());
    }
    std::this_thread::sleep_for(kPollInterval);
  }
}

FolderLock::~FolderLock() { close(file_); }

}  // namespace ubs::experiment
