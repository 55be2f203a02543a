// SPDX-License-Identifier: Apache-2.0
// See html.hpp.
#include "host/look/report/html.hpp"

#include <fmt/format.h>

#include <algorithm>

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

// Returns the hashes of the codes in the format of content security policies. This format encodes the bytes
// of a hash in Base64; PageCode contains them as hexadecimal digits.
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
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of("\n\t"), text.size());
    for (const char c : encode_text(text.substr(0, end))) append_escaped(out, c);
    if (end < text.size()) out += text[end];
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return out;
}

std::string script_json(const Json& json) {
  std::string text = json_text(json);
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos;) text.replace(at, 1, "\\u003c");
  return text;
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
  std::string style;
  for (const PageCode& code : styles) style += fmt::format("<style>{}</style>\n", code.text);
  const std::string rules =
      fmt::format("default-src 'none'; style-src{}; script-src{}; {}; base-uri 'none'; form-action 'none'",
                  policy_hashes(styles), policy_hashes(scripts), policy);
  return fmt::format(fmt::runtime(document_html()), fmt::arg("policy", escape_html(rules)),
                     fmt::arg("title", escape_html(title)), fmt::arg("styles", style),
                     fmt::arg("body", body));
}

}  // namespace ubs
