// SPDX-License-Identifier: Apache-2.0
// Which files this program made. A file that is no result of ours is never replaced or deleted.
//
// Every folder with results has a list, ".ubs-files": a line a file with the command that made it, its size,
// checksums and name. A file is ours to replace when the list has it for the same command and it still
// has that content. The line is on the disk before the file takes its name, so that neither a killed
// process nor a power cut leaves a file that is not listed, which we could not tell from the user's own and
// would refuse to replace.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace ubs {

constexpr const char* kMadeFiles = ".ubs-files";
constexpr const char* kTemporary = ".ubs-tmp-";  // what temporary files begin with

// The name of the command that is running; set once, before files are written.
void set_maker(std::string command);
std::string maker();  // "ubs" before

// CRC-32 and Adler-32: a file may end in its own CRC-32, and all such files have the same one.
struct Content {
  std::uint64_t size = 0;
  std::uint32_t crc = 0, adler = 1;
  bool operator==(const Content&) const = default;
  void add(std::span<const std::byte> bytes);
  void add(const Content& behind);
};

// True when the file is there, this command made it, and it has not been changed since.
bool is_own_result(const std::filesystem::path& file);

// True when the list of the file's folder has it, for any command and with any content.
bool is_in_list(const std::filesystem::path& file);

// Throws Error(usage), saying why, when there is something of that name, a link or a folder too, that is not
// such a file. Throws Error(data) when it cannot be read.
void check_replaceable(const std::filesystem::path& file);
void check_replaceable(const std::vector<std::filesystem::path>& files);

// From now on files of this process replace any ordinary file of their names in the folder and below it: the
// user has passed --overwrite. Deleted are still only unchanged files of the list.
void allow_overwriting(const std::filesystem::path& folder);

// Adds a line to the list of the file's folder. `grows`: `content` is what the file begins with.
void note_made(const std::filesystem::path& file, const Content& content, bool grows = false);
// The same with what a file holds that an earlier version of this program made; that it is one the caller has
// found out.
void adopt(const std::filesystem::path& file, bool grows = false);
// To be called when a file that was noted has its name: spares the questions above reading what this process
// wrote.
void remember_written(const std::filesystem::path& file);

// Removes temporary files that killed processes have left in the folder: those that nobody holds by flock.
void remove_abandoned(const std::filesystem::path& folder);

// True when all files in the folder and below it are unchanged results of `makers`, or traces of ours.
bool is_only_made(const std::filesystem::path& folder, const std::vector<std::string>& makers);

// Deletes the files in the folder (not below it) that this command, or one of `makers`, made, abandoned
// ones, and the folder when nothing is left in it. Throws Error(usage), before anything is deleted, when one
// of them was changed since; check_removable() does no more than that.
void remove_made(const std::filesystem::path& folder, const std::vector<std::string>& makers = {});
void check_removable(const std::filesystem::path& folder, const std::vector<std::string>& makers = {});

}  // namespace ubs
