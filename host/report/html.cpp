// SPDX-License-Identifier: Apache-2.0
// See html.hpp.
#include "host/report/html.hpp"

#include <algorithm>

#include "host/base/error.hpp"
#include "host/base/text.hpp"

namespace ubs {
namespace {

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

// As content security policies write hashes: Base64 of the bytes that the digits stand for.
std::string policy_hashes(const std::vector<PageCode>& codes) {
  std::string list;
  for (const PageCode& code : codes) {
    std::vector<std::uint8_t> bytes;
    for (std::size_t i = 0; i + 1 < code.sha256.size(); i += 2)
      bytes.push_back(static_cast<std::uint8_t>(std::stoi(code.sha256.substr(i, 2), nullptr, 16)));
    list += fmt::format(" 'sha256-{}'", base64(bytes));
  }
  return list;
}

}  // namespace

std::string escape_html(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (
      !text.empty()) {  // line breaks and tabs stay, other bytes that cannot stand are shown as text.hpp does
    const std::size_t end = std::min(text.find_first_of("\n\t"), text.size());
    for (const char c : encode_text(text.substr(0, end))) append_escaped(out, c);
    if (end < text.size()) out += text[end];
    text.remove_prefix(std::min(end + 1, text.size()));
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

std::string base64(std::span<const std::uint8_t> bytes) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t left = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t triple = 0;
    for (std::size_t k = 0; k < 3; ++k) triple = triple << 8 | (k < left ? bytes[i + k] : 0u);
    for (std::size_t k = 0; k < 4; ++k) out += k <= left ? kDigits[triple >> (18 - 6 * k) & 63] : '=';
  }
  return out;
}

std::string page_shell(const std::string& title, const std::vector<PageCode>& styles,
                       const std::vector<PageCode>& scripts, const std::string& policy,
                       const std::string& body) {
  Html style;
  for (const PageCode& code : styles) style += tag("style", raw(code.text));
  const Html head =
      void_tag("meta", {{"charset", "utf-8"}}) +
      void_tag("meta", {{"http-equiv", "Content-Security-Policy"},
                        {"content", fmt::format("default-src 'none'; style-src{}; script-src{}; {}; "
                                                "base-uri 'none'; form-action 'none'",
                                                policy_hashes(styles), policy_hashes(scripts), policy)}}) +
      void_tag("meta", {{"name", "viewport"}, {"content", "width=device-width, initial-scale=1"}}) +
      void_tag("link", {{"rel", "icon"}, {"href", "data:,"}}) + tag("title", text(title)) + style;
  return fmt::format("<!DOCTYPE html>\n<html lang=\"en\">\n<head>{}</head>\n<body>{}</body>\n</html>\n",
                     head.markup, body);
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
