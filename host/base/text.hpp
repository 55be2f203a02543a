// SPDX-License-Identifier: Apache-2.0
// These functions convert arbitrary bytes to text and back. File names and paths are arbitrary bytes: they
// need not be UTF-8 and may contain line breaks. JSON, YAML, HTML, CSV and PLY comments, however, consist of
// lines of UTF-8. Therefore ubs converts names with encode_text() before it writes them to a file, and with
// decode_text() after it has read them from one of its own files. This preserves every byte of a path.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace ubs {

// Returns the number of bytes of the UTF-8 sequence at `at`, or 0 if there is none. Overlong forms,
// surrogates and values above U+10FFFF are not accepted (Unicode, table 3-7).
std::size_t utf8_length(std::string_view text, std::size_t at);

// Returns valid UTF-8 without control characters. Bytes that are not valid UTF-8, and control characters, are
// replaced by an escape sequence \xHH. A backslash that starts such a sequence in the original is escaped
// too. Other text, which is almost every text, is not changed.
std::string encode_text(std::string_view bytes);
// Reverses encode_text(): decode_text(encode_text(b)) == b for all b.
std::string decode_text(std::string_view text);

// Returns a duration as text for the user, for example "4.2 s", "48 s", "6 min 5 s", "35 min" or "2 h 17
// min".
std::string duration_text(double seconds);
// Converts a string such as "90", "90s", "10m", "2 min", "1.5h" or "1h30m" into seconds. Throws Error(usage)
// with `name`, for example the name of an option, if the text is not a positive time, or if the time exceeds
// 1e7 seconds.
double parse_duration(const std::string& text, std::string_view name);

// Returns the text, shortened to about 2000 bytes if it is longer. A shortened text consists of the start and
// the end of the original, with the number of omitted bytes between them. This function is for messages that
// quote the contents of a file.
std::string shortened(std::string_view text);

// Returns the number of bytes that must be changed, added or removed to convert `a` into `b`.
std::size_t edit_distance(std::string_view a, std::string_view b);
// Returns the known word that is closest to `word` if `word` is likely to be a misspelling of it, and
// otherwise "".
std::string nearest_word(std::string_view word, std::span<const std::string> known);

// Returns the bytes as one word of a POSIX shell command. The word is quoted only if necessary.
std::string shell_word(std::string_view bytes);

}  // namespace ubs
