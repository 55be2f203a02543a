// SPDX-License-Identifier: Apache-2.0
#include "host/base/child_process.hpp"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <string_view>
#include <thread>

#include "host/base/environment.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

constexpr std::chrono::milliseconds kPollInterval{50};

// Redirects the standard streams of the child process, and replaces the process by the program arguments[0].
// This function runs between fork() and execv(), so it only calls async-signal-safe functions. execv() resets
// signal handlers to their defaults, but not ignored signals.
[[noreturn]] void become(char* const* arguments, int log, pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(127);  // the parent has died before prctl()
  for (const int number : kSignalsOfChildren) std::signal(number, SIG_DFL);
  const int nothing = open("/dev/null", O_RDONLY);
  if (nothing < 0 || dup2(nothing, STDIN_FILENO) < 0 || dup2(log, STDOUT_FILENO) < 0 ||
      dup2(log, STDERR_FILENO) < 0)
    _exit(127);
  execv(arguments[0], arguments);
  _exit(127);
}

// Collector kills the child process and waits for it, unless release() has been called. So the child does not
// keep running if `stop` throws.
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

std::string command_text(const std::vector<std::string>& arguments) {
  std::vector<std::string> words;
  for (const std::string& argument : arguments) words.push_back(encode_text(argument));
  return fmt::format("$ {}\n", fmt::join(words, " "));
}

// Writes the log file to the disk. Failures are ignored, because only users read the log, and no result
// depends on it.
void sync(const std::filesystem::path& log) {
  const int file = open(log.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) return;
  fsync(file);
  close(file);
}

}  // namespace

ChildResult run_child(const std::vector<std::string>& arguments, const std::filesystem::path& log,
                      const std::function<bool()>& stop) {
  std::vector<std::string> copies = arguments;
  std::vector<char*> pointers;
  for (std::string& argument : copies) pointers.push_back(argument.data());
  pointers.push_back(nullptr);
  write_file_atomically(log, command_text(arguments));
  const int file = open(log.c_str(), O_WRONLY | O_APPEND | O_CLOEXEC);
  if (file < 0) fail(ErrorKind::data, "{}: cannot write: {}", log.string(), std::strerror(errno));
  const pid_t parent = getpid();
  const pid_t child = fork();
  if (child == 0) become(pointers.data(), file, parent);
  close(file);
  if (child < 0) fail(ErrorKind::internal, "cannot start a process: {}", std::strerror(errno));
  Collector collector(child);
  for (;;) {
    int status = 0;
    // The result is -1 if the program has ended, but its status was discarded or another thread has taken it.
    if (waitpid(child, &status, WNOHANG) != 0) {
      collector.release();
      sync(log);
      return WIFSIGNALED(status) ? ChildResult{0, WTERMSIG(status)} : ChildResult{WEXITSTATUS(status), 0};
    }
    if (stop()) kill(child, SIGKILL);
    std::this_thread::sleep_for(kPollInterval);
  }
}

std::filesystem::path find_program(const std::string& name) {
  namespace fs = std::filesystem;
  if (name.find('/') != std::string::npos) return path_exists(name) ? fs::path(name) : fs::path();
  const std::string path = environment("PATH");
  std::string_view rest = path;
  while (!rest.empty()) {
    const std::string_view folder = rest.substr(0, rest.find(':'));
    rest.remove_prefix(std::min(rest.size(), folder.size() + 1));
    const fs::path file = fs::path(folder) / name;
    if (!folder.empty() && is_regular(file) && access(file.c_str(), X_OK) == 0) return file;
  }
  return {};
}

}  // namespace ubs
