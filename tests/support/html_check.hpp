// SPDX-License-Identifier: Apache-2.0
// check_html() checks HTML pages in tests: elements must be closed in the right order, values of attributes
// must be quoted, and every & must begin an entity. It also returns the elements of the page. It is stricter
// than browsers, which repair errors without a message.
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

namespace ubs::test {

struct HtmlElement {
  std::string name;
  std::map<std::string, std::string> attributes;  // entities are not decoded

  std::string at(const std::string& key) const {
    const auto found = attributes.find(key);
    return found == attributes.end() ? "" : found->second;
  }
};

struct HtmlCheck {
  std::string error;  // empty for a well-formed page
  std::vector<HtmlElement> elements;

  std::vector<HtmlElement> all(const std::string& name) const {
    std::vector<HtmlElement> found;
    for (const HtmlElement& e : elements)
      if (e.name == name) found.push_back(e);
    return found;
  }
  std::set<std::string> ids() const {
    std::set<std::string> found;
    for (const HtmlElement& e : elements)
      if (!e.at("id").empty()) found.insert(e.at("id"));
    return found;
  }
};

class HtmlReader {
 public:
  explicit HtmlReader(const std::string& page) : page_(page) {}

  HtmlCheck read() {
    while (at_ < page_.size() && check_.error.empty()) {
      if (page_[at_] == '<')
        read_tag();
      else
        read_text();
    }
    if (check_.error.empty() && !open_.empty()) fail("the element is not closed: " + open_.back());
    return std::move(check_);
  }

 private:
  void fail(const std::string& what) {
    if (check_.error.empty()) check_.error = fmt::format("byte {}: {}", at_, what);
  }
  bool take(const std::string& expected) {
    if (page_.compare(at_, expected.size(), expected) != 0) return false;
    at_ += expected.size();
    return true;
  }
  std::string word() {
    const std::size_t begin = at_;
    while (at_ < page_.size() && (std::isalnum(static_cast<unsigned char>(page_[at_])) || page_[at_] == '-'))
      ++at_;
    if (begin == at_) fail("a name is missing");
    return page_.substr(begin, at_ - begin);
  }
  void check_text(const std::string& text) {
    for (std::size_t i = text.find('&'); i != std::string::npos; i = text.find('&', i + 1)) {
      const std::size_t end = text.find(';', i);
      static const std::set<std::string> known{"amp", "lt", "gt", "quot", "#39"};
      if (end == std::string::npos || !known.contains(text.substr(i + 1, end - i - 1)))
        fail("the text contains a & that does not begin an entity");
    }
    if (text.find('>') != std::string::npos || text.find('<') != std::string::npos)
      fail("the text contains < or >");
  }
  void read_text() {
    const std::size_t end = std::min(page_.find('<', at_), page_.size());
    check_text(page_.substr(at_, end - at_));
    at_ = end;
  }
  void read_tag() {
    if (take("<!DOCTYPE html>")) return;
    if (take("</")) {
      const std::string name = word();
      if (open_.empty() || open_.back() != name) return fail("</" + name + "> is misplaced");
      open_.pop_back();
      if (!take(">")) fail("the end tag has no >");
      return;
    }
    ++at_;
    HtmlElement element{word(), {}};
    while (take(" ")) {
      if (take("/>")) return finish(std::move(element), true);
      const std::string key = word();
      if (!take("=\"")) return fail("the attribute has no quoted value");
      const std::size_t end = page_.find('"', at_);
      if (end == std::string::npos) return fail("a quote is not closed");
      const std::string value = page_.substr(at_, end - at_);
      if (value.size() < 5000) check_text(value);
      if (!element.attributes.emplace(key, value).second) return fail("an attribute appears twice");
      at_ = end + 1;
    }
    if (!take(">")) return fail("the start tag has no >");
    finish(std::move(element), false);
  }
  void finish(HtmlElement element, bool closed) {
    const std::string name = element.name;
    check_.elements.push_back(std::move(element));
    if (closed) return;
    if (name == "script" || name == "style") {
      at_ = std::min(page_.find("</", at_), page_.size());
      if (!take("</" + name + ">")) fail(name + " is not closed, or contains </");
      return;
    }
    open_.push_back(name);
  }

  const std::string& page_;
  std::size_t at_ = 0;
  std::vector<std::string> open_;
  HtmlCheck check_;
};

inline HtmlCheck check_html(const std::string& page) { return HtmlReader(page).read(); }

// Returns the bytes of a data URI whose media type (for example "image/png") is in `types`. For any other
// text, the result is empty.
inline std::vector<std::uint8_t> data_uri_bytes(const std::string& uri, const std::set<std::string>& types) {
  const std::size_t comma = uri.find(";base64,");
  if (!uri.starts_with("data:") || comma == std::string::npos || !types.contains(uri.substr(5, comma - 5)))
    return {};
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::vector<std::uint8_t> bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char c : uri.substr(comma + 8)) {
    if (c == '=') break;
    const std::size_t digit = digits.find(c);
    if (digit == std::string::npos) return {};
    bits = bits << 6 | static_cast<std::uint32_t>(digit);
    if ((count += 6) >= 8) bytes.push_back(static_cast<std::uint8_t>(bits >> (count -= 8) & 255));
  }
  return bytes;
}

}  // namespace ubs::test
