// SPDX-License-Identifier: Apache-2.0
// Field describes one member of a settings struct. The command line, YAML files, --set and the output of
// settings all use the same table of fields.
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

// Marks a real-valued field whose value will be chosen automatically. It is written and read as "auto".
inline constexpr double kAuto = -std::numeric_limits<double>::infinity();
// Marks an integer field whose value will be chosen from the data. It is also written and read as "auto". The
// fields that allow it have no negative values.
inline constexpr int kAutoInt = -1;
// The automatic value of a range.
inline constexpr IndexRange kAutoRange{0, 0, 0};
struct Facts;

// ChoiceRef refers to a member that is an enumeration. The number of an enumerator is the index of its word
// in Field::choices.
struct ChoiceRef {
  void* value;
  int (*get)(const void* value);
  void (*set)(void* value, int number);
};

// Returns a reference to the enumeration `Member` of the settings, for Field::member.
template <typename Settings, auto Member>
ChoiceRef choice(Settings& settings) {
  auto& value = std::invoke(Member, settings);
  using E = std::remove_reference_t<decltype(value)>;
  return {&value, [](const void* at) { return static_cast<int>(*static_cast<const E*>(at)); },
          [](void* at, int number) { *static_cast<E*>(at) = static_cast<E>(number); }};
}

// FieldUse contains flags that describe where a field is used, and what depends on it.
enum FieldUse : unsigned {
  kOfKernels = 1,     // is compiled into kernels, like N, `raster` and the variant of the model
  kFreeOnResume = 2,  // may change when a run is resumed
  kOfDrawing = 4,     // changes the renders of a trained model; is stored in model files
  kOfReading = 8,     // determines how data are read
  kSetFirst = 16,     // is shown by --help, which only shows the fields that most users need
  kOfUser = 32,       // names a place or lifts a guard: files of a run and of a model cannot set it
};

template <typename Settings>
struct Field {
  const char* key;  // name in snake_case; the command-line option has hyphens instead of underscores
  const char* help;
  std::variant<int Settings::*, std::uint64_t Settings::*, double Settings::*, bool Settings::*,
               std::string Settings::*, Background Settings::*, IndexRange Settings::*,
               ChoiceRef (*)(Settings&)>
      member;
  double min = -std::numeric_limits<double>::infinity();  // inclusive
  double max = std::numeric_limits<double>::infinity();
  bool automatic = false;         // kAuto is allowed; for a range: parts or all of it may be omitted
  const char* choices = nullptr;  // words of a choice, or allowed values of a string, separated by |
  unsigned uses = 0;              // FieldUse
  // The rule for the automatic value of a field that is decided before training (settle.hpp). It sets the
  // member of `settings`. It may use the fields that precede it in the table, which have been decided
  // already, and the settings that were `asked` for.
  using Rule = void (*)(Settings& settings, const Settings& asked, const Facts& facts);
  Rule decide = nullptr;
};

// Returns the field with these uses (FieldUse).
template <typename Settings>
Field<Settings> with_uses(unsigned uses, Field<Settings> field) {
  field.uses = uses;
  return field;
}

// FieldValue is a field that is bound to one settings object. The readers and writers of settings use it.
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
  bool decided;  // there is a rule for the automatic value
};

// Binds all fields to `settings`. The result points into `settings`, which must outlive it.
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
    values.push_back({f.key, f.help, std::visit(bind, f.member), f.min, f.max, f.automatic, f.choices, f.uses,
                      f.decide != nullptr});
  return values;
}

}  // namespace ubs
