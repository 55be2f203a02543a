// SPDX-License-Identifier: Apache-2.0
// Any bytes as text and back. File names and paths are bytes: they need not be UTF-8 and may hold line
// breaks, while JSON, YAML, HTML, CSV and PLY comments are lines of UTF-8. Every file that we write goes
// through encode_text, and what we read of our own files through decode_text, so that a path survives byte
// for byte.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace ubs {

// Bytes of the UTF-8 sequence at `at`; 0 when there is none. Overlong forms, surrogates and what lies beyond
// U+10FFFF are none (Unicode, table 3-7).
std::size_t utf8_length(std::string_view text, std::size_t at);

// Valid UTF-8 without control characters: a byte that cannot stand becomes \xHH, and so does a backslash that
// would read as the start of one. Text without any of these, nearly all there is, stays as it is.
std::string encode_text(std::string_view bytes);
// The inverse: decode_text(encode_text(b)) == b for all b.
std::string decode_text(std::string_view text);

// Returns a duration for people: "4.2 s", "48 s", "6 min 5 s", "35 min", "2 h 17 min".
std::string duration_text(double seconds);

// At most about 2000 bytes: of longer text the start and the end, and between them how much is left out. For
// messages that quote what a file holds.
std::string shortened(std::string_view text);

// A word of a POSIX shell that stands for these bytes: as it is where it needs no quotes.
std::string shell_word(std::string_view bytes);

}  // namespace ubs
