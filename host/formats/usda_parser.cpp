// SPDX-License-Identifier: Apache-2.0
// See usda_parser.hpp.
#include "host/formats/usda_parser.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "host/base/error.hpp"

namespace ubs {

static constexpr std::size_t kMaxNesting = 200;  // maximum nesting of prims

UsdLayer UsdaParser::parse() {
  if (!text_.starts_with("#usda ")) fail(ErrorKind::data, "{}: not a USD text file", name_);
  UsdLayer layer;
  if (peek() == '(')
    metadata([&](const std::string& key) {
      layer.metadata[key] = at_;
      note_arc(layer, key);
    });
  while (peek() != '\0') prim_or_statement(layer, kUsdNone, 0);
  return layer;
}

bool UsdaParser::read_array(std::size_t at, std::size_t width, std::vector<float>& values) {
  at_ = at;
  values.clear();
  if (peek() != '[') {
    if (word() == "None") return false;
    error("expected an array");
  }
  ++at_;
  while (peek() != ']') {
    if (width > 1) expect('(');
    for (std::size_t k = 0; k < width; ++k) {
      if (k > 0) expect(',');
      values.push_back(number<float>());
    }
    if (width > 1) expect(')');
    if (peek() == ',') ++at_;
  }
  return true;
}

std::vector<double> UsdaParser::read_numbers(std::size_t at) {
  constexpr std::size_t kMost = 16;
  at_ = at;
  std::vector<double> values;
  std::size_t depth = 0;
  do {
    const char c = peek();
    if (c == '(') {
      ++depth, ++at_;
    } else if (c == ')' && depth > 0) {
      --depth, ++at_;
    } else if (c == ',' && depth > 0) {
      ++at_;
    } else {
      values.push_back(number<double>());
    }
  } while (depth > 0 && values.size() <= kMost);
  return values;
}

std::string UsdaParser::read_text(std::size_t at) {
  at_ = at;
  return peek() == '"' || peek() == '\'' ? string() : std::string(word());
}

std::vector<std::string> UsdaParser::read_texts(std::size_t at) {
  at_ = at;
  std::vector<std::string> texts;
  if (peek() != '[') return texts;
  ++at_;
  while (peek() != ']') {
    texts.push_back(string());
    if (peek() == ',') ++at_;
  }
  return texts;
}

void UsdaParser::error(const std::string& what) const {
  const std::size_t end = std::min(at_, text_.size());
  const auto line = 1 + std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(end), '\n');
  fail(ErrorKind::data, "{}, line {}: {}", name_, line, what);
}

char UsdaParser::peek() {
  while (at_ < text_.size()) {
    const char c = text_[at_];
    if (c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == ';') {
      ++at_;
    } else if (c == '#' || text_.substr(at_, 2) == "//") {
      at_ = std::min(text_.find('\n', at_), text_.size());
    } else if (text_.substr(at_, 2) == "/*") {
      const std::size_t end = text_.find("*/", at_ + 2);
      if (end == std::string_view::npos) error("a comment is not closed");
      at_ = end + 2;
    } else {
      if (c == '\0') error("the text contains a zero byte");
      return c;
    }
  }
  return '\0';
}

void UsdaParser::expect(char c) {
  if (peek() != c) {
    if (at_ >= text_.size()) error("the file ends too early");
    error(fmt::format("expected '{}', found '{}'", c, shortened_rest()));
  }
  ++at_;
}

std::string UsdaParser::shortened_rest() const {
  std::string rest(text_.substr(at_, 20));
  std::ranges::replace_if(
      rest, [](unsigned char c) { return c < 32 || c > 126; }, ' ');
  return rest;
}

std::string_view UsdaParser::word() {
  if (peek() == '\0') error("the file ends too early");
  const std::size_t begin = at_;
  while (at_ < text_.size() &&
         std::string_view(" \t\r\n;=()[]{},\"'@<#").find(text_[at_]) == std::string_view::npos)
    ++at_;
  if (at_ == begin) error(fmt::format("expected a name, found '{}'", shortened_rest()));
  return text_.substr(begin, at_ - begin);
}

template <typename Number>
Number UsdaParser::number() {
  const std::string_view digits = word();
  Number value{};
  const char* const begin = digits.data() + digits.starts_with('+');
  const char* const end = digits.data() + digits.size();
  const auto [stop, code] = std::from_chars(begin, end, value);
  if (stop != end || code == std::errc::invalid_argument)
    error(fmt::format("'{}' is not a number", digits.substr(0, 40)));
  // If the number is too large or too small, from_chars does not change the value.
  if (code == std::errc::result_out_of_range) {
    const std::size_t exponent = digits.find_first_of("eE");
    const bool tiny = exponent != std::string_view::npos && digits.substr(exponent + 1).starts_with('-');
    value = tiny ? Number{0} : std::numeric_limits<Number>::infinity();
  }
  return value;
}

std::string UsdaParser::string() {
  const char quote = peek();
  if (quote != '"' && quote != '\'') error(fmt::format("expected a string, found '{}'", shortened_rest()));
  const std::string three(3, quote);
  const std::string_view end =
      text_.substr(at_).starts_with(three) ? std::string_view(three) : std::string_view(three).substr(2);
  const std::size_t begin = at_ + end.size();
  for (at_ = begin; at_ < text_.size() && !text_.substr(at_).starts_with(end);)
    at_ += text_[at_] == '\\' ? 2 : 1;
  if (at_ >= text_.size()) error("a string is not closed");
  const std::string content(text_.substr(begin, at_ - begin));
  at_ += end.size();
  return content;
}

void UsdaParser::skip_to(std::string_view end, const char* what) {
  const std::size_t found = text_.find(end, at_);
  if (found == std::string_view::npos) error(fmt::format("{} is not closed", what));
  at_ = found + end.size();
}

void UsdaParser::skip_asset() {
  const bool three = text_.substr(at_).starts_with("@@@");
  at_ += three ? 3 : 1;
  skip_to(three ? "@@@" : "@", "an asset path");
  while (three && at_ < text_.size() && text_[at_] == '@') ++at_;
}

int UsdaParser::skip_token() {
  switch (peek()) {
    case '"':
    case '\'':
      string();
      return 0;
    case '@':
      skip_asset();
      return 0;
    case '<':
      skip_to(">", "a path");
      return 0;
    case '(':
    case '[':
    case '{':
      ++at_;
      return 1;
    case ')':
    case ']':
    case '}':
      ++at_;
      return -1;
    case '=':
    case ',':
      ++at_;
      return 0;
    default:
      word();
      return 0;
  }
}

void UsdaParser::skip_value() {
  const bool reference = peek() == '@' || peek() == '<';
  int depth = 0;
  do depth += skip_token();
  while (depth > 0);
  if (depth < 0) error("a closing bracket has no opening bracket");
  if (!reference) return;
  if (peek() == '<') skip_to(">", "a path");  // the path of a prim in the referenced file
  if (peek() == '(') skip_value();            // the time offset of the reference
}

template <typename Found>
void UsdaParser::metadata(const Found& found) {
  expect('(');
  while (peek() != ')') {
    if (peek() == '"' || peek() == '\'') {
      string();
      continue;
    }
    std::string key(word());
    while (peek() != '=' && peek() != ')' && peek() != '\0') key = word();  // skips words such as "prepend"
    if (peek() != '=') error("an entry of the metadata has no value");
    ++at_;
    peek();
    const std::size_t value = at_;
    found(key);
    at_ = value;
    skip_value();
  }
  ++at_;
}

void UsdaParser::note_arc(UsdLayer& layer, const std::string& key) {
  for (const char* arc :
       {"subLayers", "references", "payload", "inherits", "specializes", "variants", "clips"})
    if (key == arc) layer.arcs.insert(key);
}

void UsdaParser::prim_or_statement(UsdLayer& layer, std::size_t parent, std::size_t depth) {
  const std::string first(word());
  if (first == "def" || first == "over" || first == "class") return prim(layer, parent, depth, first);
  if (first == "variantSet") {
    layer.arcs.insert(first);
    string();
    expect('=');
    return skip_value();
  }
  if (first == "reorder") {
    word();
    expect('=');
    return skip_value();
  }
  if (parent == kUsdNone) error(fmt::format("expected a prim, found '{}'", first.substr(0, 40)));
  property(layer.prims[parent], first);
}

void UsdaParser::prim(UsdLayer& layer, std::size_t parent, std::size_t depth, const std::string& specifier) {
  if (depth >= kMaxNesting) error(fmt::format("prims are nested deeper than {} levels", kMaxNesting));
  UsdPrim prim;
  if (peek() != '"' && peek() != '\'') prim.type = word();
  prim.name = string();
  prim.parent = parent;
  prim.drawn = specifier == "def" && (parent == kUsdNone || layer.prims[parent].drawn);
  if (peek() == '(')
    metadata([&](const std::string& key) {
      note_arc(layer, key);
      if (key != "active") return;
      const std::string value(word());
      if (value == "0" || value == "false") prim.drawn = false;
    });
  const std::size_t index = layer.prims.size();
  layer.prims.push_back(std::move(prim));
  expect('{');
  while (peek() != '}') prim_or_statement(layer, index, depth + 1);
  ++at_;
}

void UsdaParser::property(UsdPrim& prim, const std::string& first) {
  std::string type = first;
  for (const char* prefix : {"prepend", "append", "delete", "add", "custom", "uniform", "varying", "config"})
    if (type == prefix) type = word();
  if (peek() == '[') {
    ++at_;
    expect(']');
  }
  std::string name(word());
  const std::string_view suffix = ".timeSamples";
  const bool samples = name.ends_with(suffix);
  if (samples) name.resize(name.size() - suffix.size());
  if (peek() == '=') {
    ++at_;
    peek();
    UsdProperty& property = prim.properties[name];
    if (samples) {
      read_samples(property);
    } else {
      property.value = at_;
      skip_value();
    }
  }
  if (peek() == '(') metadata([](const std::string&) {});
}

void UsdaParser::read_samples(UsdProperty& property) {
  property.samples.clear();
  expect('{');
  while (peek() != '}') {
    std::string_view code = word();
    const bool joined = code.ends_with(':');
    if (joined) code.remove_suffix(1);
    double time = 0;
    const auto [stop, result] = std::from_chars(code.data(), code.data() + code.size(), time);
    if (result != std::errc() || stop != code.data() + code.size() || !std::isfinite(time))
      error(fmt::format("'{}' is not a time code", code.substr(0, 40)));
    if (!joined) expect(':');
    peek();
    property.samples.emplace_back(time, at_);
    skip_value();
    if (peek() == ',') ++at_;
  }
  ++at_;
}

}  // namespace ubs
