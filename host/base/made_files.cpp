// SPDX-License-Identifier: Apache-2.0
// See made_files.hpp. A line of the list: command, "whole" or "begins", bytes, both checksums in hexadecimal,
// name; one space between.
#include "host/base/made_files.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <fstream>
#include <limits>
#include <map>
#include <mutex>
#include <ranges>
#include <span>
#include <string_view>
#include <system_error>

#include "host/base/error.hpp"
#include "host/base/paths.hpp"
#include "host/base/text.hpp"
#include "host/base/uninterrupted.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kOwnTraces = ".ubs-";  // lists, locks, temporary files
constexpr const char* kExplanation =
    "\n# Files here that ubs made, as it left them; only these does it replace or delete. Without this list: "
    "none.";

struct Line {
  std::string maker, name;
  Content content;
  bool grows = false;
};

std::mutex made_mutex;
std::string current_maker = "ubs";
// What this process wrote, by device and inode: for which command, size, times of content and inode.
struct Written {
  std::string maker;
  std::array<std::int64_t, 5> state;
};
std::map<std::array<std::uint64_t, 2>, Written> written;
std::vector<fs::path> overwritten;  // resolved folders

template <typename Number>
bool read_whole_number(std::string_view word, int base, Number& number) {
  const auto end = std::from_chars(word.data(), word.data() + word.size(), number, base);
  return end.ec == std::errc() && end.ptr == word.data() + word.size();
}

// Without a stream: every file that is written asks for all lines of its folder.
bool parse(std::string_view text, Line& line) {
  std::array<std::string_view, 4> words;
  for (std::string_view& word : words) {
    const std::size_t end = text.find(' ');
    if (end == std::string_view::npos) return false;
    word = text.substr(0, end);
    text.remove_prefix(end + 1);
  }
  const auto& [command, kind, bytes, sums] = words;
  std::uint64_t both = 0;
  if (sums.size() != 16 || !read_whole_number(sums, 16, both) ||
      !read_whole_number(bytes, 10, line.content.size))
    return false;
  line.maker = command;
  line.name = decode_text(text);
  line.grows = kind == "begins";
  line.content.crc = static_cast<std::uint32_t>(both >> 32);
  line.content.adler = static_cast<std::uint32_t>(both);
  return (line.grows || kind == "whole") && !line.name.empty() && line.name.find('/') == std::string::npos &&
         line.name != "." && line.name != "..";
}

// Lines that are none of ours, as a power cut may leave them, say nothing.
std::vector<Line> read_list(const fs::path& folder) {
  std::vector<Line> lines;
  std::ifstream stream(folder / kMadeFiles, std::ios::binary);
  for (std::string text; std::getline(stream, text);)
    if (Line line; parse(text, line)) lines.push_back(std::move(line));
  return lines;
}

// Of the first `most` bytes.
Content content_of(const fs::path& file, std::uint64_t most) {
  std::ifstream stream(file, std::ios::binary);
  if (!stream) fail(ErrorKind::data, "{}: cannot open: {}", file.string(), std::strerror(errno));
  Content content;
  std::vector<char> piece(std::size_t{1} << 16);
  while (content.size < most && stream) {
    stream.read(piece.data(),
                static_cast<std::streamsize>(std::min<std::uint64_t>(piece.size(), most - content.size)));
    const auto bytes = std::span(piece).first(static_cast<std::size_t>(stream.gcount()));
    content.add(std::as_bytes(bytes));
  }
  return content;
}

std::array<std::uint64_t, 2> place(const struct stat& s) { return {s.st_dev, s.st_ino}; }
std::array<std::int64_t, 5> state(const struct stat& s) {
  return {s.st_size, s.st_mtim.tv_sec, s.st_mtim.tv_nsec, s.st_ctim.tv_sec, s.st_ctim.tv_nsec};
}

bool is_as_written(const struct stat& status, const std::vector<std::string>& makers) {
  const std::lock_guard lock(made_mutex);
  const auto found = written.find(place(status));
  return found != written.end() && found->second.state == state(status) &&
         std::ranges::find(makers, found->second.maker) != makers.end();
}

// Empty, or why the file may not be deleted or replaced by one of `makers`.
std::string objection(const fs::path& file, const struct stat& status, const std::vector<Line>& lines,
                      const std::vector<std::string>& makers) {
  if (S_ISLNK(status.st_mode)) return "is a symbolic link";
  if (!S_ISREG(status.st_mode)) return "is not an ordinary file";
  if (is_as_written(status, makers)) return "";
  const std::string name = file.filename().string();
  const auto size = static_cast<std::uint64_t>(status.st_size);
  std::map<std::uint64_t, Content> contents;  // of so many first bytes: each is read once
  const auto matches = [&](const Line& line) {
    const std::uint64_t bytes = line.content.size;
    if (line.grows ? size < bytes : size != bytes) return false;
    if (!contents.contains(bytes)) contents.emplace(bytes, content_of(file, bytes));
    return contents.at(bytes) == line.content;
  };
  std::string other;
  bool changed = false;
  for (const Line& line : std::views::reverse(lines)) {  // the newest is most likely what is there
    if (line.name != name) continue;
    const bool equal = matches(line);
    const bool own = std::ranges::find(makers, line.maker) != makers.end();
    if (equal && own) return "";
    if (equal && other.empty()) other = line.maker;
    changed |= !equal;
  }
  if (!other.empty()) return fmt::format("was made by 'ubs {}'", other);
  if (changed) return "was changed since it was made";
  if (!lines.empty()) return "is not known to be made by this program";
  return "is not known to be made by this program (earlier versions kept no list)";
}

bool may_overwrite(const fs::path& folder) {
  const fs::path resolved = resolved_path(folder);
  const std::lock_guard lock(made_mutex);
  return std::ranges::any_of(overwritten, [&](const fs::path& allowed) {
    return std::ranges::mismatch(allowed, resolved).in1 == allowed.end();
  });
}

[[noreturn]] void refuse(const fs::path& file, const std::string& why) {
  fail(ErrorKind::usage, "{}: {}, so it is not replaced: move it away or delete it, or choose another name",
       file.string(), why);
}

// False where there is nothing of that name.
bool look(const fs::path& file, struct stat& status) {
  if (::lstat(file.c_str(), &status) == 0) return true;
  if (errno == ENOENT || errno == ENOTDIR) return false;  // who writes the file says what is amiss
  fail(ErrorKind::data, "{}: {}", file.string(), std::strerror(errno));
}

// Files in the folder that are listed for `makers`, once each.
std::vector<fs::path> made_in(const fs::path& folder, const std::vector<Line>& lines,
                              const std::vector<std::string>& makers) {
  std::vector<fs::path> files;
  for (const Line& line : lines)
    if (std::ranges::find(makers, line.maker) != makers.end()) files.push_back(folder / line.name);
  std::ranges::sort(files);
  files.erase(std::ranges::unique(files).begin(), files.end());
  return files;
}

std::vector<std::string> or_this(const std::vector<std::string>& makers) {
  return makers.empty() ? std::vector{maker()} : makers;
}

// One call, so that lines of several processes do not mix. The line feed comes first: a line that a full disk
// cut short spoils no other, and neither does another process that begins the list too. On the disk
// afterwards.
void append(const fs::path& folder, const std::string& line) {
  const fs::path list = folder / kMadeFiles;
  const int file = ::open(list.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666);
  struct stat status {};
  const bool fresh = file >= 0 && ::fstat(file, &status) == 0 && status.st_size == 0;
  const std::string text = fmt::format("{}\n{}", fresh ? kExplanation : "", line);
  const bool done = file >= 0 &&
                    ::write(file, text.data(), text.size()) == static_cast<ssize_t>(text.size()) &&
                    uninterrupted([&] { return ::fsync(file); }) == 0;
  const int reason = errno;
  if (file >= 0) ::close(file);
  if (!done)
    fail(ErrorKind::data, "{}: writing failed: {} (disk full?)", list.string(), std::strerror(reason));
  if (fresh) sync_folder(folder);
}

}  // namespace

std::string maker() {
  const std::lock_guard lock(made_mutex);
  return current_maker;
}

void set_maker(std::string command) {
  const std::lock_guard lock(made_mutex);
  current_maker = std::move(command);
}

bool is_own_result(const fs::path& file) {
  struct stat status {};
  return look(file, status) && objection(file, status, read_list(folder_of(file)), {maker()}).empty();
}

bool is_in_list(const fs::path& file) {
  return std::ranges::any_of(read_list(folder_of(file)),
                             [&](const Line& line) { return line.name == file.filename().string(); });
}

void check_replaceable(const fs::path& file) { check_replaceable(std::vector{file}); }

void check_replaceable(const std::vector<fs::path>& files) {
  std::map<fs::path, std::vector<Line>> lists;
  for (const fs::path& file : files) {
    struct stat status {};
    if (!look(file, status)) continue;
    if (S_ISDIR(status.st_mode)) fail(ErrorKind::data, "{}: is a folder, cannot write a file", file.string());
    const fs::path folder = folder_of(file);
    if (S_ISREG(status.st_mode) && may_overwrite(folder)) continue;
    const auto list =
        lists.contains(folder) ? lists.find(folder) : lists.emplace(folder, read_list(folder)).first;
    if (const std::string why = objection(file, status, list->second, {maker()}); !why.empty())
      refuse(file, why);
  }
}

void allow_overwriting(const fs::path& folder) {
  const fs::path resolved = resolved_path(folder);
  const std::lock_guard lock(made_mutex);
  overwritten.push_back(resolved);
}

void note_made(const fs::path& file, const Content& content, bool grows) {
  append(folder_of(file),
         fmt::format("{} {} {} {:08x}{:08x} {}", maker(), grows ? "begins" : "whole", content.size,
                     content.crc, content.adler, encode_text(file.filename().string())));
}

void Content::add(std::span<const std::byte> bytes) {
  if (bytes.empty()) return;  // zlib takes a null pointer for the wish to start anew
  const auto* data = reinterpret_cast<const Bytef*>(bytes.data());
  crc = static_cast<std::uint32_t>(::crc32_z(crc, data, bytes.size()));
  adler = static_cast<std::uint32_t>(::adler32_z(adler, data, bytes.size()));
  size += bytes.size();
}

void Content::add(const Content& behind) {
  const auto length = static_cast<z_off_t>(behind.size);
  crc = static_cast<std::uint32_t>(::crc32_combine(crc, behind.crc, length));
  adler = static_cast<std::uint32_t>(::adler32_combine(adler, behind.adler, length));
  size += behind.size;
}

void adopt(const fs::path& file, bool grows) {
  note_made(file, content_of(file, std::numeric_limits<std::uint64_t>::max()), grows);
}

void remember_written(const fs::path& file) {
  struct stat status {};
  if (!look(file, status)) return;
  const std::lock_guard lock(made_mutex);
  written[place(status)] = {current_maker, state(status)};
}

void remove_abandoned(const fs::path& folder) {
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (!at->path().filename().native().starts_with(kTemporary)) continue;
    const int file = ::open(at->path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    if (file < 0) continue;
    if (::flock(file, LOCK_EX | LOCK_NB) == 0) ::unlink(at->path().c_str());
    ::close(file);
  }
}

bool is_only_made(const fs::path& folder, const std::vector<std::string>& makers) {
  const std::vector<Line> lines = read_list(folder);
  return std::ranges::all_of(folder_entries(folder), [&](const fs::path& entry) {
    struct stat status {};
    if (!look(entry, status)) return true;
    if (S_ISDIR(status.st_mode)) return is_only_made(entry, makers);
    return entry.filename().native().starts_with(kOwnTraces) ||
           objection(entry, status, lines, makers).empty();
  });
}

void check_removable(const fs::path& folder, const std::vector<std::string>& makers) {
  const std::vector<Line> lines = read_list(folder);
  const std::vector<std::string> ours = or_this(makers);
  if (may_overwrite(folder)) return;  // remove_made() passes over what was changed
  for (const fs::path& file : made_in(folder, lines, ours)) {
    struct stat status {};
    if (!look(file, status)) continue;
    const std::string why = objection(file, status, lines, ours);
    if (!why.empty()) refuse(file, why);
  }
}

void remove_made(const fs::path& folder, const std::vector<std::string>& makers) {
  check_removable(folder, makers);
  const std::vector<Line> lines = read_list(folder);
  const bool keeps_changed = may_overwrite(folder);
  for (const fs::path& file : made_in(folder, lines, or_this(makers))) {
    struct stat status {};
    if (keeps_changed && look(file, status) && !objection(file, status, lines, or_this(makers)).empty())
      continue;
    if (::unlink(file.c_str()) != 0 && errno != ENOENT)
      fail(ErrorKind::data, "{}: cannot be deleted: {}", file.string(), std::strerror(errno));
  }
  remove_abandoned(folder);
  std::error_code error;
  const bool listed = std::ranges::any_of(
      lines, [&](const Line& line) { return fs::exists(fs::symlink_status(folder / line.name, error)); });
  if (!listed) ::unlink((folder / kMadeFiles).c_str());
  ::rmdir(folder.c_str());  // where something is left it stays
}

}  // namespace ubs
