// SPDX-License-Identifier: Apache-2.0
// Tests the conversion of settings from and to text and YAML (host/scene): every field is preserved, and
// every mistake is reported.
#include <catch2/catch.hpp>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>

#include "host/base/text.hpp"
#include "host/settings/fields.hpp"
#include "host/settings/train_settings.hpp"
#include "host/train/run_settings.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using test::message_of;
using test::put;
using test::TempFolder;

// Contains every kind of member once, with values that need all digits.
struct Sample {
  int whole = 3;
  std::uint64_t big = 7;
  double real = 0.5, chosen = kAuto;
  bool flag = false;
  std::string mode = "one", text;
  Background triple{};
  IndexRange range{0, 9, 1};
};
const Field<Sample> kFields[] = {
    {"whole", "a", &Sample::whole, 1, 10}, {"big", "b", &Sample::big, 0},
    {"real", "c", &Sample::real, 0, 1},    {"chosen", "d", &Sample::chosen, -5, 5, true},
    {"flag", "e", &Sample::flag},          {"mode", "f", &Sample::mode, -1, 1, false, "one|two"},
    {"text", "g", &Sample::text},          {"triple", "h", &Sample::triple, 0, 1},
    {"range", "i", &Sample::range, 0, 9}};

std::vector<FieldValue> bound(Sample& sample) {
  return bind_fields(sample, std::span<const Field<Sample>>(kFields));
}

std::string usage_message(const std::string& key, const std::string& value) {
  Sample sample;
  return message_of([&] { set_field(bound(sample), key, value, "--set"); }, ErrorKind::usage);
}

TEST_CASE("settings: numbers may end with k or M, and colours may be names or hexadecimal digits") {
  TrainSettings settings;
  const auto set = [&](const char* key, const char* text) {
    set_field(bind_fields(settings, train_fields()), key, text, "--set");
  };
  for (const auto& [text, number] :
       {std::pair{"7k", 7000}, {"300K", 300000}, {"1.5M", 1500000}, {"2.5k", 2500}}) {
    set("cap_max", text);
    CHECK(settings.cap_max == number);
  }
  for (const char* wrong : {"k", "7kk", "1.2345k", "7 k", "7m", "7G"})
    CHECK_THROWS_AS(set("cap_max", wrong), Error);
  using Colour = std::array<double, 3>;
  for (const auto& [text, colour] : {std::pair{"white", Colour{1, 1, 1}},
                                     {"black", {0, 0, 0}},
                                     {"gray", {0.5, 0.5, 0.5}},
                                     {"#ffffff", {1, 1, 1}},
                                     {"#0f0", {0, 1, 0}},
                                     {"#3300CC", {0.2, 0, 0.8}}}) {
    set("background", text);
    CHECK(settings.background.colour == colour);
  }
  for (const char* wrong : {"#ff", "#fffffg", "ffffff", "whit", "#-1-1-1"})
    CHECK_THROWS_AS(set("background", wrong), Error);
}

TEST_CASE("settings: a background is a colour, a sky, or learnt") {
  TrainSettings settings;
  const auto set = [&](const std::string& text) {
    set_field(bind_fields(settings, train_fields()), "background", text, "--set");
  };
  std::string sky = "0.1,0.2,0.3";
  for (int i = 0; i < 24; ++i) sky += fmt::format(",{}", 0.25 * i - 3);
  for (const std::string& text : {std::string("0.5,0,1"), sky, std::string("learn"), std::string("sky")}) {
    set(text);
    const auto fields = bind_fields(settings, train_fields());
    const auto field = std::ranges::find(fields, std::string_view("background"), &FieldValue::key);
    CHECK(field_text(*field) == text);
    const TempFolder folder;
    put(folder / "all.yaml", to_yaml(fields));
    TrainSettings read;
    load_yaml(bind_fields(read, train_fields()), folder / "all.yaml");
    CHECK(read.background == settings.background);
    CHECK(to_json(fields)["background"].dump() == (text == "0.5,0,1" ? "[0.5,0.0,1.0]" : '"' + text + '"'));
  }
  for (const std::string& text : {std::string("0.5,0"), std::string("2,0,0"), sky + ",1", std::string("blue"),
                                  std::string("0,0,nan"), sky.substr(0, sky.rfind(',')) + ",inf"})
    CHECK_THAT(message_of([&] { set(text); }, ErrorKind::usage),
               Catch::Contains("three numbers r,g,b 0 to 1, white"));
  settings.background.learnt = Background::Learnt::sky;
  settings.refine_cameras = RefineCameras::pose;
  CHECK_THAT(message_of([&] { validate(settings); }, ErrorKind::usage),
             Catch::Contains("does not support background = sky"));
}

TEST_CASE("settings: text is read into every kind of field") {
  Sample s;
  const auto fields = bound(s);
  for (const char* assignment : {"whole=1e1", "big=18446744073709551615", "real=0.25", "chosen=-3", "flag=on",
                                 "mode=two", "text=30,60", "triple= 0.5, 1,0.125", "range=1:9:2"})
    set_field(fields, assignment, "--set");
  CHECK(s.whole == 10);
  CHECK(s.big == std::numeric_limits<std::uint64_t>::max());
  CHECK(s.real == 0.25);
  CHECK(s.chosen == -3);
  CHECK(s.flag);
  CHECK(s.mode == "two");
  CHECK(s.text == "30,60");
  CHECK(s.triple.colour == std::array{0.5, 1.0, 0.125});
  CHECK(s.range == IndexRange{1, 9, 2});
  set_field(fields, "chosen", "auto", "--set");
  CHECK(s.chosen == kAuto);
}

TEST_CASE("settings: an invalid value is rejected, and the message contains it") {
  const std::pair<const char*, const char*> wrong[] = {
      {"whole", "0"},    {"whole", "11"},  {"whole", "1.5"},    {"whole", ""},         {"whole", "3x"},
      {"whole", "1e99"}, {"big", "-1"},    {"real", "nan"},     {"real", "inf"},       {"real", "-inf"},
      {"real", "auto"},  {"real", "1.01"}, {"chosen", "6"},     {"flag", "maybe"},     {"mode", "three"},
      {"mode", ""},      {"triple", "1"},  {"triple", "0,0,2"}, {"triple", "0,0,nan"}, {"triple", "0,0,0,0"},
      {"range", ""},     {"range", "1:9"}, {"range", "1:10:1"}};
  for (const auto& [key, value] : wrong) {
    INFO(key << " = " << value);
    const std::string message = usage_message(key, value);
    CHECK(message.find(key) != std::string::npos);
    CHECK(message.find(std::string("'") + value + "'") != std::string::npos);
  }
  CHECK(usage_message("whole", "0").find("integer 1 to 10") != std::string::npos);
}

TEST_CASE("settings: a failed assignment does not change the value") {
  Sample s;
  message_of([&] { set_field(bound(s), "triple", "0.5,0.5,7", "--set"); }, ErrorKind::usage);
  CHECK(s.triple.colour == std::array{0.0, 0.0, 0.0});
}

TEST_CASE("settings: the error for an unknown key only suggests a similar key") {
  CHECK(usage_message("wohle", "1").find("did you mean 'whole'") != std::string::npos);
  CHECK(usage_message("zzzzzzzz", "1").find("did you mean") == std::string::npos);
  const std::vector<std::string> known{"set", "out", "iterations"};
  for (const char* other : {"quiet", "seed", "port", "device"}) CHECK(nearest_word(other, known) == "");
  for (const char* slip : {"sett", "oit", "itertaions"}) CHECK(nearest_word(slip, known) != "");
  Sample s;
  CHECK(message_of([&] { set_field(bound(s), "whole", "--set"); }, ErrorKind::usage).find("key=value") !=
        std::string::npos);
}

TEST_CASE("settings: written YAML is read back exactly") {
  const TempFolder folder;
  Sample s;
  s.whole = 9;
  s.big = 18446744073709551615u;
  s.real = 0.1 + 0.2;  // needs 17 digits
  s.chosen = 1e-300;
  s.flag = true;
  s.mode = "two";
  s.text = "it's: #1, 'quoted'";
  s.triple.colour = {1.0 / 3, 0, 1};
  for (const double chosen : {1e-3, kAuto}) {
    s.chosen = chosen;
    put(folder / "a.yaml", to_yaml(bound(s)));
    Sample read;
    load_yaml(bound(read), folder / "a.yaml");
    CHECK(read.whole == s.whole);
    CHECK(read.big == s.big);
    CHECK(read.real == s.real);
    CHECK(read.chosen == s.chosen);
    CHECK(read.flag == s.flag);
    CHECK(read.mode == s.mode);
    CHECK(read.text == s.text);
    CHECK(read.triple == s.triple);
  }
  CHECK(to_json(bound(s))["chosen"] == "auto");
  CHECK(to_json(bound(s))["big"] == 18446744073709551615u);
  CHECK(to_json(bound(s))["triple"][0] == 1.0 / 3);
}

std::string yaml_message(const std::string& text) {
  const TempFolder folder;
  put(folder / "bad.yaml", text);
  Sample s;
  return message_of([&] { load_yaml(bound(s), folder / "bad.yaml"); });
}

TEST_CASE("settings: errors in YAML contain file, line and column") {
  CHECK(
      yaml_message("whole: 3\nwohle: 4\n").find("bad.yaml:2:1: unknown key 'wohle'; did you mean 'whole'") !=
      std::string::npos);
  CHECK(yaml_message("# note\n\n  whole: many\n").find("bad.yaml:3:3: whole = 'many'") != std::string::npos);
  CHECK(yaml_message("whole: {a: 1}\n").find("bad.yaml:1:1: whole must be a value") != std::string::npos);
  CHECK(yaml_message("whole:\n").find("bad.yaml:1:1: whole must be a value, not empty") != std::string::npos);
  CHECK(yaml_message("triple: [0, [1], 0]\n").find("nested") != std::string::npos);
  CHECK(yaml_message("whole: 3\nwhole: 4\n").find("bad.yaml:2:1: key 'whole' appears twice") !=
        std::string::npos);
  CHECK(yaml_message("- 1\n- 2\n").find("must be a mapping") != std::string::npos);
  CHECK(yaml_message("whole: [1, 2\n").find("bad.yaml:2") != std::string::npos);
  CHECK(yaml_message("real: .nan\n").find("real = '.nan'") != std::string::npos);
}

TEST_CASE(
    "settings: YAML that is nested deeply, grows by aliases or contains itself is rejected immediately") {
  const std::string deep(200'000, '[');
  CHECK(yaml_message("triple: " + deep).find("malformed YAML") != std::string::npos);
  CHECK(yaml_message("triple: " + deep + std::string(deep.size(), ']')).find("bad.yaml") !=
        std::string::npos);
  std::string laughs = "l0: &l0 [1, 1]\n";  // expanding all aliases would give 2^64 values
  for (int i = 1; i < 64; ++i) laughs += fmt::format("l{0}: &l{0} [*l{1}, *l{1}]\n", i, i - 1);
  CHECK(yaml_message(laughs + "triple: *l63\n").find("bad.yaml:1:1: unknown key 'l0'") != std::string::npos);
  CHECK(yaml_message("triple: &t [*t, *t]\n").find("bad.yaml") != std::string::npos);
  CHECK(yaml_message("&a triple: [&b [1, 1], *b, *b]\n").find("nested list") != std::string::npos);
  CHECK(yaml_message("<<: {whole: 4}\n").find("bad.yaml:1:1: << must be a value") != std::string::npos);
}

// In earlier versions, the time was quadratic in the number of keys, and this test took minutes.
TEST_CASE("settings: YAML with 200 000 unknown keys is rejected") {
  std::string keys;
  for (int i = 0; i < 200'000; ++i) keys += fmt::format("k{}: {}\n", i, i);
  CHECK(yaml_message(keys).find("bad.yaml:1:1: unknown key 'k0'") != std::string::npos);
}

TEST_CASE("settings: YAML lists and empty files are read") {
  const TempFolder folder;
  Sample s;
  put(folder / "empty.yaml", "# nothing\n");
  load_yaml(bound(s), folder / "empty.yaml");
  CHECK(s.whole == 3);
  put(folder / "list.yaml", "triple: [0.5, 0.25, 1]\nwhole: 4\n");
  load_yaml(bound(s), folder / "list.yaml");
  CHECK(s.triple.colour == std::array{0.5, 0.25, 1.0});
  CHECK(s.whole == 4);
  CHECK(message_of([&] { load_yaml(bound(s), folder / "none.yaml"); }).find("no such file") !=
        std::string::npos);
}

TEST_CASE("train settings: the defaults are inside their ranges, and keys are unique") {
  TrainSettings settings;
  std::set<std::string> keys;
  const auto fields = bind_fields(settings, train_fields());
  for (const FieldValue& field : fields) {
    INFO(field.key);
    CHECK(keys.insert(field.key).second);
    CHECK(std::string(field.help).size() > 5);
    CHECK_NOTHROW(set_field(fields, field.key, field_text(field), "default"));
  }
  CHECK_NOTHROW(validate(settings));
}

// A member of the struct that is missing from the table would be lost in config.yaml. The total size of the
// members in the table may only differ from the size of the struct by padding. list_counts, run_cameras and
// chosen are not settings of a run.
TEST_CASE("train settings: the table contains every member") {
  const TrainSettings s;
  std::size_t listed = sizeof(s.list_counts) + sizeof(s.run_cameras) + sizeof(s.chosen);
  const auto size = [](auto member) {
    if constexpr (std::is_member_pointer_v<decltype(member)>)
      return sizeof(TrainSettings{}.*member);
    else
      return sizeof(OnNan);  // the field is a choice, which is stored as an enumeration
  };
  for (const auto& field : train_fields()) listed += std::visit(size, field.member);
  CHECK(listed <= sizeof(TrainSettings));
  // The observed padding is 28 bytes (g++ 12, x86-64). A number of type double that is missing in the table
  // would add 8 bytes, and a missing text or colour would add more.
  CHECK(sizeof(TrainSettings) - listed <= 35);
}

TEST_CASE("train settings: invalid values and combinations are rejected") {
  const auto message = [](auto change) {
    TrainSettings s;
    change(s);
    return message_of([&] { validate(s); }, ErrorKind::usage);
  };
  CHECK(message([](auto& s) { s.far_plane = s.near_plane = 2; }).find("far_plane") != std::string::npos);
  for (const char* text : {"30,20", "a", "-1", "", "s", "30m", "nan", "1.5"})
    CHECK(message([&](auto& s) { s.eval_every = text; }).find("eval_every") != std::string::npos);
  TrainSettings s;
  s.eval_every = "60.5s";
  CHECK(evaluation_interval(s).seconds == 60.5);
  CHECK(evaluation_interval(s).iterations == 0);
  const auto set = [&](const char* key, const char* text) {
    set_field(bind_fields(s, train_fields()), key, text, "test");
  };
  const auto refused = [&](const char* key, const char* text) {
    return message_of([&] { set(key, text); }, ErrorKind::usage).find(key) != std::string::npos;
  };
  for (const char* text : {"a", "3:1", "-1", "1:2:0", "1:2:3:4", "1:", ":5", "1::2", "99999999999"})
    CHECK(refused("frames", text));
  CHECK(message([](auto& with) { with.frames.end = with.frames.first; }).find("frames") != std::string::npos);
  const auto before_a_sky = [](auto& with) {
    with.refine_cameras = RefineCameras::pose;
    with.background.harmonics.assign(24, 0.1);
  };
  CHECK(message(before_a_sky).find("sky") != std::string::npos);
  set("frames", "4:300:2");
  CHECK(s.frames == IndexRange{4, 300, 2});
  set("frames", "10");
  CHECK(to_string(s.frames) == "10");  // config.yaml contains this text, which can be read again
  set("frames", "");
  CHECK(s.frames == IndexRange{});
  set("frames", "0");  // selects all frames
  CHECK(s.frames == IndexRange{});
  // refine needs three numbers, which must be within the schedule.
  for (const char* text : {"", "500", "500:25000", "500:100:1", "0:30001:1", "0:0:0"})
    CHECK(refused("refine", text));
  set("refine", "0:0:1");
  CHECK(s.refine.empty());
  CHECK(message([](auto& with) { with.refine = {26000, 25000, 100}; }).find("refine") != std::string::npos);
}

TEST_CASE("data_specs: every specification of a run can be loaded") {
  std::size_t found = 0;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(UBS_SOURCE_DIR) + "/data_specs")) {
    if (entry.path().extension() != ".yaml") continue;
    INFO(entry.path().string());
    TrainSettings settings;
    CHECK_NOTHROW(load_yaml(bind_fields(settings, train_fields()), entry.path()));
    CHECK_NOTHROW(validate(settings));
    ++found;
  }
  CHECK(found >= 3);
}

}  // namespace
}  // namespace ubs
