// SPDX-License-Identifier: Apache-2.0
// UsdaParser reads OpenUSD text files. It visits prims and their properties, and stores the position of each
// property's value in the text; only the values that are needed are converted to numbers. It does not follow
// references, payloads, sublayers or variants. All errors are Error(data), and their messages contain the
// name of the file and, unless the file is not a USD text file at all, the line.
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

// UsdProperty contains the positions of a property's values in the text.
struct UsdProperty {
  std::size_t value = kUsdNone;  // kUsdNone if the property has no value, or only time samples
  std::vector<std::pair<double, std::size_t>> samples;  // time code, and position of the value
};

struct UsdPrim {
  std::string type, name;
  std::size_t parent = kUsdNone;
  bool drawn = true;  // whether this prim and all prims above it are definitions and active
  std::map<std::string, UsdProperty, std::less<>> properties;
};

struct UsdLayer {
  std::map<std::string, std::size_t, std::less<>> metadata;  // position of the value of each key
  std::vector<UsdPrim> prims;
  // Composition arcs: statements that refer to other files, or choose among parts of this file.
  std::set<std::string> arcs;
};

class UsdaParser {
 public:
  UsdaParser(std::string_view text, const std::string& name) : text_(text), name_(name) {}

  // Parses the whole text.
  UsdLayer parse();

  // ---- The following functions read the value at a position `at` of the text ----

  // Sets `values` to the numbers of an array whose elements have `width` numbers. Returns false for None.
  bool read_array(std::size_t at, std::size_t width, std::vector<float>& values);

  // Returns the numbers of a single value: a number, a tuple, or a tuple of tuples.
  std::vector<double> read_numbers(std::size_t at);

  // Returns a string or token.
  std::string read_text(std::size_t at);

  // Returns the strings of an array.
  std::vector<std::string> read_texts(std::size_t at);

 private:
  [[noreturn]] void error(const std::string& what) const;

  // Skips blanks and comments and returns the next character, or 0 at the end of the text.
  char peek();

  void expect(char c);

  std::string shortened_rest() const;

  // Returns a keyword, type or name: all characters up to a blank or a special character.
  std::string_view word();

  template <typename Number>
  Number number();

  // Skips a string, which is enclosed in one or three single or double quotes. Returns its content without
  // converting escapes.
  std::string string();

  void skip_to(std::string_view end, const char* what);

  void skip_asset();

  // Skips one string, asset path, path, bracket or word. Returns how the nesting depth of brackets changed.
  int skip_token();

  void skip_value();

  // Parses the metadata of a layer, prim or property. Calls found(key) for each entry. At this time,
  // the parser is at the value of the entry.
  template <typename Found>
  void metadata(const Found& found);

  static void note_arc(UsdLayer& layer, const std::string& key);

  // Parses one item of a layer or of a prim.
  void prim_or_statement(UsdLayer& layer, std::size_t parent, std::size_t depth);

  void prim(UsdLayer& layer, std::size_t parent, std::size_t depth, const std::string& specifier);

  // Parses a property, which has the form [custom] [uniform] type[[]] name[.timeSamples] [= value]
  // [(metadata)]. `first` is its first word.
  void property(UsdPrim& prim, const std::string& first);

  void read_samples(UsdProperty& property);

  std::string_view text_;
  const std::string& name_;
  std::size_t at_ = 0;
};

}  // namespace ubs
