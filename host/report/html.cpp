// SPDX-License-Identifier: Apache-2.0
// See html.hpp.
#include "host/report/html.hpp"

#include <algorithm>

#include "host/base/error.hpp"

namespace ubs {
namespace {

constexpr std::string_view kReplacement = "\xef\xbf\xbd";

bool continues(std::string_view text, std::size_t at) {
  return at < text.size() && (static_cast<unsigned char>(text[at]) & 0xc0) == 0x80;
}

// Bytes of the UTF-8 sequence at `at`; 0 when there is none. Overlong forms, surrogates and what lies beyond
// U+10FFFF are none (Unicode, table 3-7).
std::size_t sequence_length(std::string_view text, std::size_t at) {
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  const unsigned char lead = byte(at);
  if (lead < 0x80) return 1;
  const std::size_t length = lead >= 0xc2 && lead < 0xe0   ? 2
                             : lead >= 0xe0 && lead < 0xf0 ? 3
                             : lead >= 0xf0 && lead < 0xf5 ? 4
                                                           : 0;
  for (std::size_t i = 1; i < length; ++i)
    if (!continues(text, at + i)) return 0;
  if (length < 3) return length;
  const unsigned char second = byte(at + 1);
  const bool wrong = (lead == 0xe0 && second < 0xa0) || (lead == 0xed && second > 0x9f) ||
                     (lead == 0xf0 && second < 0x90) || (lead == 0xf4 && second > 0x8f);
  return wrong ? 0 : length;
}

void append_escaped(std::string& out, char c) {
  switch (c) {
    case '&':
      out += "&amp;";
      return;
    case '<':
      out += "&lt;";
      return;
    case '>':
      out += "&gt;";
      return;
    case '"':
      out += "&quot;";
      return;
    case '\'':
      out += "&#39;";
      return;
  }
  const bool control = (static_cast<unsigned char>(c) < 0x20 && c != '\t' && c != '\n') || c == 0x7f;
  if (control)
    out += kReplacement;
  else
    out += c;
}

std::string opening(std::string_view name, const Attributes& attributes) {
  const auto is_name_letter = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-';
  };
  const auto check = [&](std::string_view word) {
    if (word.empty() || !std::all_of(word.begin(), word.end(), is_name_letter))
      fail(ErrorKind::internal, "'{}' is no name of an element or attribute", word);
  };
  check(name);
  std::string out = fmt::format("<{}", name);
  for (const auto& [key, value] : attributes) {
    check(key);
    out += fmt::format(" {}=\"{}\"", key, escape_html(value));
  }
  return out;
}

Html cell(std::string_view name, const TableCell& cell) {
  return cell.style.empty() ? tag(name, cell.content) : tag(name, {{"class", cell.style}}, cell.content);
}

}  // namespace

std::string escape_html(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t length = sequence_length(text, i);
    if (length == 0) {
      out += kReplacement;
      ++i;
    } else if (length == 1) {
      append_escaped(out, text[i++]);
    } else {
      out += text.substr(i, length);
      i += length;
    }
  }
  return out;
}

Html text(std::string_view text) { return {escape_html(text)}; }
Html raw(std::string markup) { return {std::move(markup)}; }

Html tag(std::string_view name, const Attributes& attributes, const Html& content) {
  return {fmt::format("{}>{}</{}>", opening(name, attributes), content.markup, name)};
}
Html tag(std::string_view name, const Html& content) { return tag(name, {}, content); }
Html void_tag(std::string_view name, const Attributes& attributes) {
  return {opening(name, attributes) + " />"};
}

Html table(const TableRow& head, const std::vector<TableRow>& rows,
           const std::vector<std::string>& row_styles) {
  Html head_cells, body;
  for (const TableCell& c : head) head_cells += cell("th", c);
  for (std::size_t r = 0; r < rows.size(); ++r) {
    Html cells;
    for (std::size_t c = 0; c < rows[r].size(); ++c) cells += cell(c == 0 ? "th" : "td", rows[r][c]);
    const bool styled = r < row_styles.size() && !row_styles[r].empty();
    body += (styled ? tag("tr", {{"class", row_styles[r]}}, cells) : tag("tr", cells)) + raw("\n");
  }
  const Html inner = (head.empty() ? Html{} : tag("thead", tag("tr", head_cells))) + tag("tbody", body);
  return tag("div", {{"class", "scroll"}}, tag("table", inner));
}

}  // namespace ubs
