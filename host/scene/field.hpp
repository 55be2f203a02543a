// SPDX-License-Identifier: Apache-2.0
// Describes one field of a settings struct, so that command line, YAML, --set and output share one table.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <span>
#include <string>
#include <type_traits>
#include <variant>
#include <vector>

#include "host/base/background.hpp"
#include "host/base/index_range.hpp"

namespace ubs {

// Value of a real field that is to be chosen from the data; written and read as "auto".
inline constexpr double kAuto = -std::numeric_limits<double>::infinity();
// The same of a whole-number field, none of which has 0 in its range.
inline constexpr int kAutoInt = 0;

// A member that is an enumeration: its numbers are the places of the words in Field::choices.
struct ChoiceRef {
  void* value;
  int (*get)(const void* value);
  void (*set)(void* value, int number);
};

// For Field::member: the enumeration that `Member` finds in the settings.
template <typename Settings, auto Member>
ChoiceRef choice(Settings& settings) {
  auto& value = std::invoke(Member, settings);
  using E = std::remove_reference_t<decltype(value)>;
  return {&value, [](const void* at) { return static_cast<int>(*static_cast<const E*>(at)); },
          [](void* at, int number) { *static_cast<E*>(at) = static_cast<E>(number); }};
}

// What a field is for, beside the training of a model.
enum FieldUse : unsigned {
  kOfKernels = 1,     // kernels are specialised by it, beside N, `raster` and the form of the model
  kFreeOnResume = 2,  // may change when a run is resumed
  kOfDrawing = 4,     // changes the picture of a finished model: model files remember it
  kOfReading = 8,     // says how data are read
  kSetFirst = 16,     // what users set first: --help shows it, --help-all the others
};

template <typename Settings>
struct Field {
  const char* key;  // snake_case; the option is --key with hyphens
  const char* help;
  std::variant<int Settings::*, std::uint64_t Settings::*, double Settings::*, bool Settings::*,
               std::string Settings::*, Background Settings::*, IndexRange Settings::*,
               ChoiceRef (*)(Settings&)>
      member;
  double min = -std::numeric_limits<double>::infinity();  // inclusive
  double max = std::numeric_limits<double>::infinity();
  bool automatic = false;         // kAuto is allowed; of a range, that parts are left out or all
  const char* choices = nullptr;  // words of a choice, allowed values of a text; separated by |
  unsigned uses = 0;              // FieldUse
};

// A field bound to one settings object; what the readers and writers of settings work on.
struct FieldValue {
  using Pointer =
      std::variant<int*, std::uint64_t*, double*, bool*, std::string*, Background*, IndexRange*, ChoiceRef>;
  const char* key;
  const char* help;
  Pointer value;
  double min, max;
  bool automatic;
  const char* choices;
  unsigned uses;
};

// The values point into `settings`, which must outlive them.
template <typename Settings>
std::vector<FieldValue> bind_fields(Settings& settings, std::span<const Field<Settings>> fields) {
  std::vector<FieldValue> values;
  const auto bind = [&](auto member) -> FieldValue::Pointer {
    if constexpr (std::is_member_pointer_v<decltype(member)>)
      return &(settings.*member);
    else
      return member(settings);
  };
  for (const Field<Settings>& f : fields)
    values.push_back(
        {f.key, f.help, std::visit(bind, f.member), f.min, f.max, f.automatic, f.choices, f.uses});
  return values;
}

}  // namespace ubs
