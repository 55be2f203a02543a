// SPDX-License-Identifier: Apache-2.0
// Converts arbitrary bytes to text and back. File names and paths are bytes: they need not be UTF-8 and may
// contain line breaks, whereas JSON, YAML, HTML, CSV and PLY comments are lines of UTF-8. Everything that ubs
// writes to files goes through encode_text(), and what it reads from its own files goes through
// decode_text(), so that paths are preserved byte for byte.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace ubs {

// Returns the number of bytes of the UTF-8 sequence at `at`, or 0 if there is none. Overlong forms,
// surrogates and values above U+10FFFF are not accepted (Unicode, table 3-7).
std::size_t utf8_length(std::string_view text, std::size_t at);

// Returns valid UTF-8 without control characters: bytes that are not allowed become \xHH, and so does a
// backslash that would read as the start of such a code. Text that contains none of these, which is nearly
// all text, stays unchanged.
std::string encode_text(std::string_view bytes);
// Reverses encode_text(): decode_text(encode_text(b)) == b for all b.
std::string decode_text(std::string_view text);

// Returns a duration for people: "4.2 s", "48 s", "6 min 5 s", "35 min", "2 h 17 min".
std::string duration_text(double seconds);

// Returns at most about 2000 bytes. Longer text is reduced to its start and end, with the number of omitted
// bytes between them. This function is for messages that quote the contents of a file.
std::string shortened(std::string_view text);

// Returns a word for a POSIX shell that stands for these bytes. It is quoted only if necessary.
std::string shell_word(std::string_view bytes);

}  // namespace ubs
