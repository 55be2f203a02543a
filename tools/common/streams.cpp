// SPDX-License-Identifier: Apache-2.0
#include "tools/common/streams.hpp"

#include <fcntl.h>
#include <poll.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>

#include "host/base/error.hpp"

namespace ubs::tools {
namespace {

bool files_first = false, silent = false;
int failure = 0;  // errno of the first write to stdout that failed

// Returns whether stdout is a pipe without readers, or a closed terminal (EIO).
bool reader_gone() { return failure == EPIPE || failure == EIO; }

// Finds the reason why an earlier write to stdout failed. This is needed because CLI11 prints the help text
// itself, and stdio does not store the reason.
int reason_of_old_failure() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & POLLERR) != 0 ? EPIPE : ENOSPC;
}

void failed(int reason) {
  if (failure == 0) failure = reason;
  if (files_first) return;
  if (reader_gone()) throw ReaderGone{};
  fail(ErrorKind::data, "cannot write to standard output: {}", std::strerror(failure));
}

}  // namespace

void prepare_streams() {
  for (int number = STDIN_FILENO; number <= STDERR_FILENO; ++number)
    if (::fcntl(number, F_GETFD) < 0 && errno == EBADF)
      ::open("/dev/null", O_RDWR);  // opens the lowest free number
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

void files_before_output() { files_first = true; }

void silence_out() { silent = true; }

void print_out(std::string_view text) {
  if (failure != 0 || silent) return;
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size()) failed(errno);
}

void flush_out() {
  if (failure == 0 && std::fflush(stdout) != 0) failed(errno);
}

void print_err(std::string_view text) noexcept {
  const int before = errno;
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
  errno = before;
}

int finish_streams(int code, std::string& complaint) {
  if (failure == 0) {
    errno = 0;
    const bool old = std::ferror(stdout) != 0;
    if (std::fflush(stdout) != 0)
      failure = errno;
    else if (old)
      failure = reason_of_old_failure();
  }
  if (failure == 0 || (reader_gone() && files_first)) return code;
  if (!reader_gone()) complaint = fmt::format("cannot write to standard output: {}", std::strerror(failure));
  return code == 0 ? exit_code(ErrorKind::data) : code;
}

}  // namespace ubs::tools
