// SPDX-License-Identifier: Apache-2.0
// Describes one field of a settings struct, so that command line, YAML, --set and output share one table.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <variant>
#include <vector>

namespace ubs {

// Value of a real field that is to be chosen from the data; written and read as "auto".
inline constexpr double kAuto = -std::numeric_limits<double>::infinity();
// The same of a whole-number field, none of which has 0 in its range.
inline constexpr int kAutoInt = 0;

template <typename Settings>
struct Field {
  const char* key;  // snake_case; the option is --key with hyphens
  const char* help;
  std::variant<int Settings::*, std::uint64_t Settings::*, double Settings::*, bool Settings::*,
               std::string Settings::*, std::array<double, 3> Settings::*>
      member;
  double min = -std::numeric_limits<double>::infinity();  // inclusive
  double max = std::numeric_limits<double>::infinity();
  bool automatic = false;         // kAuto is allowed
  const char* choices = nullptr;  // allowed values of a text field, separated by |
};

// A field bound to one settings object; what the readers and writers of settings work on.
struct FieldValue {
  using Pointer = std::variant<int*, std::uint64_t*, double*, bool*, std::string*, std::array<double, 3>*>;
  const char* key;
  const char* help;
  Pointer value;
  double min, max;
  bool automatic;
  const char* choices;
};

// The values point into `settings`, which must outlive them.
template <typename Settings>
std::vector<FieldValue> bind_fields(Settings& settings, std::span<const Field<Settings>> fields) {
  std::vector<FieldValue> values;
  for (const Field<Settings>& f : fields)
    values.push_back(
        {f.key, f.help,
         std::visit([&](auto member) { return FieldValue::Pointer(&(settings.*member)); }, f.member), f.min,
         f.max, f.automatic, f.choices});
  return values;
}

}  // namespace ubs
