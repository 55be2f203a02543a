// SPDX-License-Identifier: Apache-2.0
// See text.hpp.
#include "host/base/text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <vector>

#include "host/base/error.hpp"

namespace ubs {
namespace {

int digit_of(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

// Returns whether `text` contains an escape sequence \xHH at position `at`. HH are two hexadecimal digits in
// lower case, as encode_text() writes them.
bool is_escape(std::string_view text, std::size_t at) {
  return text.substr(at, 2) == "\\x" && at + 4 <= text.size() && digit_of(text[at + 2]) >= 0 &&
         digit_of(text[at + 3]) >= 0;
}

// Returns the number of seconds of a unit of time, or 0 if the word is not a unit. An empty word means
// seconds.
double seconds_of_unit(std::string_view unit) {
  const auto is = [&](auto... words) { return ((unit == words) || ...); };
  if (is("", "s", "sec", "secs", "second", "seconds")) return 1;
  if (is("m", "min", "mins", "minute", "minutes")) return 60;
  if (is("h", "hr", "hrs", "hour", "hours")) return 3600;
  return 0;
}

}  // namespace

std::size_t utf8_length(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(at);
  if (lead < 0x80) return 1;
  const std::size_t length = lead >= 0xc2 && lead < 0xe0   ? 2
                             : lead >= 0xe0 && lead < 0xf0 ? 3
                             : lead >= 0xf0 && lead < 0xf5 ? 4
                                                           : 0;
  for (std::size_t i = 1; i < length; ++i)
    if (at + i >= text.size() || (byte(at + i) & 0xc0) != 0x80) return 0;
  if (length < 3) return length;
  const unsigned char second = byte(at + 1);
  const bool wrong = (lead == 0xe0 && second < 0xa0) || (lead == 0xed && second > 0x9f) ||
                     (lead == 0xf0 && second < 0x90) || (lead == 0xf4 && second > 0x8f);
  return wrong ? 0 : length;
}

std::string encode_text(std::string_view bytes) {
  std::string text;
  text.reserve(bytes.size());
  for (std::size_t i = 0; i < bytes.size();) {
    const std::size_t length = utf8_length(bytes, i);
    const auto byte = static_cast<unsigned char>(bytes[i]);
    if (length == 0 || byte < 0x20 || byte == 0x7f || is_escape(bytes, i)) {
      text += fmt::format("\\x{:02x}", byte);
      ++i;
    } else {
      text += bytes.substr(i, length);
      i += length;
    }
  }
  return text;
}

std::string shortened(std::string_view text) {
  constexpr std::size_t kStart = 1400, kEnd = 500;
  if (text.size() <= kStart + kEnd + 100) return std::string(text);
  const auto inside = [&](std::size_t at) { return (static_cast<unsigned char>(text[at]) & 0xc0) == 0x80; };
  std::size_t first = kStart, last = text.size() - kEnd;
  for (int i = 0; i < 3 && inside(first); ++i) --first;  // do not cut UTF-8 characters
  for (int i = 0; i < 3 && inside(last); ++i) ++last;
  return fmt::format("{} [... {} bytes ...] {}", text.substr(0, first), last - first, text.substr(last));
}

std::string decode_text(std::string_view text) {
  std::string bytes;
  bytes.reserve(text.size());
  for (std::size_t i = 0; i < text.size();) {
    if (is_escape(text, i)) {
      bytes += static_cast<char>(16 * digit_of(text[i + 2]) + digit_of(text[i + 3]));
      i += 4;
    } else {
      bytes += text[i++];
    }
  }
  return bytes;
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = row[0]++;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] != b[j]);
      diagonal = row[j + 1];
      row[j + 1] = std::min({replaced, row[j] + 1, row[j + 1] + 1});
    }
  }
  return row.back();
}

std::string nearest_word(std::string_view word, std::span<const std::string> known) {
  std::string best;
  std::size_t least = 2 + word.size() / 5;  // words with this many differences are not suggested
  for (const std::string& candidate : known)
    if (const std::size_t d = edit_distance(word, candidate); d < least) {
      least = d;
      best = candidate;
    }
  return best;
}

std::string shell_word(std::string_view bytes) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=./:,@%";
  if (!bytes.empty() && bytes.find_first_not_of(kPlain) == std::string_view::npos) return std::string(bytes);
  std::string word = "'";
  for (const char c : bytes) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

std::string duration_text(double seconds) {
  if (seconds < 9.95) return fmt::format("{:.1f} s", seconds);
  const long long s = std::llround(seconds), m = std::llround(seconds / 60);
  if (s < 60) return fmt::format("{} s", s);
  if (s < 600) return fmt::format("{} min {} s", s / 60, s % 60);
  if (m < 60) return fmt::format("{} min", m);
  return fmt::format("{} h {} min", m / 60, m % 60);
}

double parse_duration(const std::string& text, std::string_view name) {
  const char *at = text.data(), *const end = at + text.size();
  double seconds = 0;
  bool valid = at != end;
  while (valid && at != end) {
    double value = 0;
    const auto result = std::from_chars(at, end, value);
    const char* const unit = std::find_if(result.ptr, end, [](char c) { return c != ' '; });
    at = std::find_if(unit, end, [](char c) { return c < 'a' || c > 'z'; });
    const double factor = seconds_of_unit({unit, at});
    at = std::find_if(at, end, [](char c) { return c != ' '; });
    valid = result.ec == std::errc() && factor > 0 && value > 0 && std::isfinite(value);
    seconds += value * factor;
  }
  if (!valid || seconds > 1e7)
    fail(ErrorKind::usage, "{} '{}' must be a time such as 90s, 10m, 1.5h or 1h 30min", name, text);
  return seconds;
}

}  // namespace ubs
