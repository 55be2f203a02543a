// SPDX-License-Identifier: Apache-2.0
#include "tools/common/row_log.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "tools/common/output.hpp"

namespace ubs::tools {

RowLog::~RowLog() {
  if (file_ >= 0) ::close(file_);
}

void RowLog::start(std::filesystem::path path, const std::string& content) {
  path_ = std::move(path);
  write_file_atomically(path_, content, FileUse::log);
  file_ = ::open(path_.c_str(), O_WRONLY | O_CLOEXEC);
  if (file_ < 0) fail(ErrorKind::data, "{}: cannot write: {}", path_.string(), std::strerror(errno));
  written_ = static_cast<long long>(content.size());
}

// At the end of the last whole row, over what an earlier try may have left of the next one.
bool RowLog::write_pending() {
  for (std::size_t done = 0; done < pending_.size();) {
    const auto bytes = ::pwrite(file_, pending_.data() + done, pending_.size() - done,
                                written_ + static_cast<long long>(done));
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes < 0) {
      reason_ = errno;
      return false;
    }
    done += static_cast<std::size_t>(bytes);
  }
  written_ += static_cast<long long>(pending_.size());
  pending_.clear();
  return true;
}

void RowLog::add(const std::string& row) {
  pending_ += row + '\n';
  if (write_pending() || warned_) return;
  warned_ = true;
  warn("{}: writing failed: {} (disk full?); its rows are kept and tried again", path_.string(),
       std::strerror(reason_));
}

void RowLog::sync() {
  if (file_ < 0) return;
  bool done = write_pending();
  while (done && ::fsync(file_) != 0) {
    if (errno == EINTR) continue;
    reason_ = errno;
    done = false;
  }
  if (!done)
    fail(ErrorKind::data, "{}: writing failed: {} (disk full?)", path_.string(), std::strerror(reason_));
}

}  // namespace ubs::tools
