// SPDX-License-Identifier: Apache-2.0
// UsdaParser reads the text form of OpenUSD: it walks through prims and their properties, and remembers where
// the value of each property is in the text. Numbers are read only from the values that are needed.
// References, payloads, sublayers and variants are not followed. Everything throws Error(data) with the name
// and the line.
#pragma once

#include <cstddef>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace ubs {

inline constexpr std::size_t kUsdNone = std::numeric_limits<std::size_t>::max();

// Where the values of a property are in the text; kUsdNone: it has none.
struct UsdProperty {
  std::size_t value = kUsdNone;
  std::vector<std::pair<double, std::size_t>> samples;  // time code, value
};

struct UsdPrim {
  std::string type, name;
  std::size_t parent = kUsdNone;
  bool drawn = true;  // a definition, active, below prims that are such
  std::map<std::string, UsdProperty, std::less<>> properties;
};

struct UsdLayer {
  std::map<std::string, std::size_t, std::less<>> metadata;  // of the layer
  std::vector<UsdPrim> prims;
  std::set<std::string> arcs;  // what refers to other files, or chooses among parts of this one
};

class UsdaParser {
 public:
  UsdaParser(std::string_view text, const std::string& name) : text_(text), name_(name) {}

  UsdLayer parse();

  // ---- Values, read at the place where they stand ----

  // Sets `values` to the numbers of an array whose elements have `width` numbers. Returns false for None.
  bool read_array(std::size_t at, std::size_t width, std::vector<float>& values);

  // Returns the numbers of a single value: a number, a tuple, or a tuple of tuples.
  std::vector<double> read_numbers(std::size_t at);

  // Returns a string or token.
  std::string read_text(std::size_t at);

  // Returns the strings of an array of them.
  std::vector<std::string> read_texts(std::size_t at);

 private:
  [[noreturn]] void error(const std::string& what) const;

  // The next character that is neither blank nor part of a comment; 0 at the end.
  char peek();

  void expect(char c);

  std::string shortened_rest() const;

  // A keyword, type or name: up to a blank or a character that has a meaning of its own.
  std::string_view word();

  template <typename Number>
  Number number();

  // Skips a string in any of its four forms, and returns what is in it with its escapes as they stand.
  std::string string();

  void skip_to(std::string_view end, const char* what);

  void skip_asset();

  // One string, asset path, path or bracket, or one word; returns how the depth of brackets changed.
  int skip_token();

  void skip_value();

  // `found` is called for each entry, with the parser at its value.
  template <typename Found>
  void metadata(const Found& found);

  static void note_arc(UsdLayer& layer, const std::string& key);

  // What stands in a layer or a prim.
  void prim_or_statement(UsdLayer& layer, std::size_t parent, std::size_t depth);

  void prim(UsdLayer& layer, std::size_t parent, std::size_t depth, const std::string& specifier);

  // [custom] [uniform] type[[]] name[.timeSamples] [= value] [(metadata)]
  void property(UsdPrim& prim, const std::string& first);

  void read_samples(UsdProperty& property);

  std::string_view text_;
  const std::string& name_;
  std::size_t at_ = 0;
};

}  // namespace ubs
