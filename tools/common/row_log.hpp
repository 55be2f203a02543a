// SPDX-License-Identifier: Apache-2.0
// A text file that grows by rows while a run goes on, and that the run does not fail by: rows that cannot be
// written are kept in memory and tried again with the next one.
#pragma once

#include <filesystem>
#include <string>

namespace ubs::tools {

class RowLog {
 public:
  RowLog() = default;
  ~RowLog();
  RowLog(const RowLog&) = delete;
  RowLog& operator=(const RowLog&) = delete;

  // Replaces the file, which must be ours (FileUse::log), and goes on behind `content`. Throws Error.
  void start(std::filesystem::path path, const std::string& content);
  // A line without its end. A row that cannot be written is a warning, once.
  void add(const std::string& row);
  // Rows so far are on the disk. Throws Error(data) when some cannot be written.
  void sync();

 private:
  bool write_pending();

  std::filesystem::path path_;
  std::string pending_;
  long long written_ = 0;  // bytes of whole rows in the file
  int file_ = -1, reason_ = 0;
  bool warned_ = false;
};

}  // namespace ubs::tools
