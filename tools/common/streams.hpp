// SPDX-License-Identifier: Apache-2.0
// Standard output and error of the subcommands: results go to stdout, remarks to stderr. What a remark cannot
// be written to is no reason to stop. What a result cannot be written to is an error (exit code 3), also
// where the system notices it at the end only. A reader that went away (`ubs info M.ply | head -1`) ends a
// command that prints, without a word; a command that writes files goes on, and its output is dropped.
#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>
#include <utility>

namespace ubs::tools {

// First thing in main(), before any file is opened: the null device where 0, 1 or 2 are closed, so that no
// file gets their numbers. Writing to a closed pipe, or beyond the largest size of a file (ulimit -f),
// becomes an error of the call instead of the end of the process.
void prepare_streams();

// For commands whose product are files, before their first output: what cannot be printed does not stop them.
void files_before_output();

// Nothing goes to stdout from now on.
void silence_out();

// Thrown by print_out() when nobody reads; no error for the user to see.
struct ReaderGone {};

// To stdout. Throws Error(data) or ReaderGone unless files_before_output() was called.
void print_out(std::string_view text);
// To stderr. Never fails.
void print_err(std::string_view text) noexcept;
void flush_out();

// The exit code of a command that wants to end with `code`: where stdout was not written whole, 3 instead of
// 0, and `complaint` is what to say about it (empty: nothing). To be called once, at the end of main().
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
