// SPDX-License-Identifier: Apache-2.0
// These functions write to standard output and standard error for the subcommands. Results go to stdout,
// remarks to stderr. If a remark cannot be written, the command continues. If a result cannot be written,
// this is an error (exit code 3), even if the system reports it only at the end. If the reader of a pipe has
// gone away (`ubs info M.ply | head -1`), a command that only prints ends without a message; a command that
// writes files continues, and its output is discarded.
#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>
#include <utility>

namespace ubs::tools {

// Must be called at the beginning of main(), before any file is opened. Opens the null device for those of
// the file descriptors 0, 1 and 2 that are closed, so that no other file gets these numbers. After this
// call, writing to a closed pipe, or beyond the maximum file size (ulimit -f), fails with an error instead
// of ending the process.
void prepare_streams();

// Must be called by commands whose results are files, before their first output. After this call, the command
// continues even if its printed output cannot be written.
void files_before_output();

// Discards all further output to stdout.
void silence_out();

// Thrown by print_out() if stdout has no reader. The user gets no error message.
struct ReaderGone {};

// Prints to stdout. If this fails, throws Error(data), or ReaderGone if the reader of stdout has gone away.
// Throws nothing if files_before_output() was called.
void print_out(std::string_view text);
// Prints to stderr. Never fails.
void print_err(std::string_view text) noexcept;
void flush_out();

// Returns the exit code of a command that ends with `code`. If stdout was not written completely, this is 3
// instead of 0, unless files_before_output() was called and the reader of stdout has gone away. Sets
// `complaint` to the error message, or leaves it empty if there is none. Must be called once, at the end of
// main().
int finish_streams(int code, std::string& complaint);

template <typename... Args>
void say(fmt::format_string<Args...> format, Args&&... args) {
  print_out(fmt::format(format, std::forward<Args>(args)...));
}

template <typename... Args>
void remark(fmt::format_string<Args...> format, Args&&... args) {
  print_err(fmt::format(format, std::forward<Args>(args)...));
}

}  // namespace ubs::tools
