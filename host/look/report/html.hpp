// SPDX-License-Identifier: Apache-2.0
// These functions build self-contained HTML pages: the document with its content security policy, and text
// and data in a form in which nothing from a file or a folder name is interpreted as markup.
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

// Returns json_text() in a form that is safe inside of a script element: no string in it can close the
// element.
std::string script_json(const Json& json);

std::string base64(std::span<const std::uint8_t> bytes);

inline constexpr const char* kNoScript = "<noscript>This page needs JavaScript.</noscript>\n";

// A style sheet or script of a page. `text` must not contain "</"; `sha256` is its hash in hexadecimal
// digits.
struct PageCode {
  std::string text, sha256;
};

// Returns a document that does not use the network. Its content security policy contains the hashes of
// `styles`, which page_shell() writes into the head, and of `scripts`, which `body` must contain, so that the
// browser runs nothing else. `policy` holds further directives.
std::string page_shell(const std::string& title, const std::vector<PageCode>& styles,
                       const std::vector<PageCode>& scripts, const std::string& policy,
                       const std::string& body);

}  // namespace ubs
