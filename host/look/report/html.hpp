// SPDX-License-Identifier: Apache-2.0
// These functions build self-contained HTML pages. page_shell() builds the document with its content security
// policy. escape_html() and script_json() encode text and data, so that a browser does not interpret contents
// of files or names of folders as markup.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "host/base/json.hpp"

namespace ubs {

// Returns `text` with & < > " ' as entities. Bytes that are not UTF-8, and control characters except tab and
// line break, are written as encode_text() writes them.
std::string escape_html(std::string_view text);

// Returns the JSON as text that is safe inside of a script element: no string in it can close the element.
std::string script_json(const Json& json);

// Returns the bytes in Base64 encoding.
std::string base64(std::span<const std::uint8_t> bytes);

// PageCode is a style sheet or a script of a page. `text` must not contain "</"; `sha256` is its hash in
// hexadecimal digits.
struct PageCode {
  std::string text, sha256;
};

// Returns the embedded file document.html, the frame of all pages. It has places for the arguments of
// page_shell(), such as {title}. Other braces in the file must be doubled.
std::string document_html();

// Returns a document that does not use the network. page_shell() writes `styles` into the head. `body` must
// contain `scripts`. The content security policy of the document contains the hashes of the styles and
// scripts, so that the browser uses no others. `policy` contains further directives of the policy.
std::string page_shell(const std::string& title, const std::vector<PageCode>& styles,
                       const std::vector<PageCode>& scripts, const std::string& policy,
                       const std::string& body);

}  // namespace ubs
