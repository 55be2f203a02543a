// SPDX-License-Identifier: Apache-2.0
// HTML by construction: every element is closed, and text that is not known to be markup is escaped. A string
// becomes Html through text() or raw() only, so that nothing from a file or a folder's name reaches a page as
// markup. Void elements are written as <img ... />.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace ubs {

struct Html {
  std::string markup;

  Html& operator+=(const Html& more) {
    markup += more.markup;
    return *this;
  }
  bool empty() const { return markup.empty(); }
};
inline Html operator+(Html a, const Html& b) { return a += b; }

using Attributes = std::vector<std::pair<std::string_view, std::string>>;

// & < > " ' as entities; bytes that are no UTF-8, and control characters but tab and new line, as in
// text.hpp.
std::string escape_html(std::string_view text);

Html text(std::string_view text);  // escaped
Html raw(std::string markup);      // ours, as it is
// Values of attributes are escaped. Throws Error(internal) for a name that is none.
Html tag(std::string_view name, const Attributes& attributes, const Html& content);
Html tag(std::string_view name, const Html& content);
Html void_tag(std::string_view name, const Attributes& attributes);  // img, meta, br

struct TableCell {
  Html content;
  std::string style = {};  // its class
};
using TableRow = std::vector<TableCell>;

std::string base64(std::span<const std::uint8_t> bytes);

// Style or script of a page, which does not hold "</"; the hash is of the text, in hexadecimal digits.
struct PageCode {
  std::string text, sha256;
};
// A document and no network: should a name ever get into it as markup, it can neither run nor fetch anything.
// Its content security policy lets `styles`, which the head holds, and `scripts`, which the body brings, do
// what they do; `policy`: what it says beside them.
std::string page_shell(const std::string& title, const std::vector<PageCode>& styles,
                       const std::vector<PageCode>& scripts, const std::string& policy,
                       const std::string& body);

// Rows may be shorter than the head; the first cell of a row is its head. `row_styles`: none, or one a row.
Html table(const TableRow& head, const std::vector<TableRow>& rows,
           const std::vector<std::string>& row_styles = {});

}  // namespace ubs
