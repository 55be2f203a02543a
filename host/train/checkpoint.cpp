// SPDX-License-Identifier: Apache-2.0
#include "host/train/checkpoint.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/spec/settings.hpp"

namespace ubs {
namespace {

constexpr std::string_view kCheckpointMagic = "UBSCKPT\n";
constexpr std::uint32_t kCheckpointVersion = 1;
constexpr std::size_t kFixedBytes = 16;  // magic, version, header bytes
static_assert(std::endian::native == std::endian::little, "checkpoints are written as they are in memory");

// Writes and keeps the CRC-32 of what it wrote.
class Writer {
 public:
  explicit Writer(const std::filesystem::path& path) : file_(path) {}
  void bytes(std::span<const std::byte> data) {
    crc_ = crc32(data, crc_);
    file_.write(data);
  }
  template <typename T>
  void numbers(const std::vector<T>& values) {
    bytes(std::as_bytes(std::span(values)));
  }
  void word(std::uint32_t value) { bytes(std::as_bytes(std::span(&value, 1))); }
  void commit() {
    word(crc_);
    file_.commit();
  }

 private:
  AtomicFile file_;
  std::uint32_t crc_ = 0;
};

Json settings_json(TrainSettings settings) {
  Json json = Json::object();
  for (const FieldValue& field : bind_fields(settings, train_fields())) json[field.key] = field_text(field);
  return json;
}

Json header_of(const Checkpoint& c) {
  const TrainState& s = c.state;
  Json variant = Json::array();
  for (const int number : variant_numbers(s.model.variant)) variant.push_back(number);
  return {{"dim", s.model.dim},
          {"variant", variant},
          {"splats", s.model.count},
          {"values", s.model.values.size()},
          {"moments", s.moment1.size()},
          {"loss_sums", s.loss_sums.size()},
          {"appearance", s.appearance.size()},
          {"cameras", s.cameras.size()},
          {"iteration", s.iteration},
          {"logged", s.logged},
          {"adam_steps", s.adam_steps},
          {"seconds", s.seconds},
          {"skipped_draws", s.skipped_draws},
          {"rollbacks", s.rollbacks},
          {"dropped", s.dropped},
          {"data", c.data},
          {"data_print", c.data_print},
          {"device", c.device},
          {"build", c.build},
          {"planned_seconds", c.planned_seconds},
          {"settings", settings_json(c.settings)}};
}

// Takes pieces from the front of a file's content.
class Reader {
 public:
  Reader(std::span<const std::byte> content, std::string name) : rest_(content), name_(std::move(name)) {}
  std::span<const std::byte> bytes(std::size_t count) {
    if (count > rest_.size())
      fail(ErrorKind::data, "{}: truncated checkpoint: {} bytes are missing", name_, count - rest_.size());
    const auto piece = rest_.first(count);
    rest_ = rest_.subspan(count);
    return piece;
  }
  std::uint32_t word() {
    std::uint32_t value = 0;
    std::memcpy(&value, bytes(sizeof value).data(), sizeof value);
    return value;
  }
  template <typename T>
  void numbers(std::vector<T>& to, std::uint64_t count) {
    if (count > rest_.size() / sizeof(T))
      fail(ErrorKind::data, "{}: truncated checkpoint: {} numbers wanted, {} bytes left", name_, count,
           rest_.size());
    to.resize(count);
    const auto piece = bytes(count * sizeof(T));
    if (count > 0) std::memcpy(to.data(), piece.data(), piece.size());
  }
  std::size_t left() const { return rest_.size(); }

 private:
  std::span<const std::byte> rest_;
  std::string name_;
};

void read_settings(const Json& json, TrainSettings& settings, const std::string& name) {
  const std::vector<FieldValue> fields = bind_fields(settings, train_fields());
  try {
    for (const auto& [key, value] : json.items()) set_field(fields, key, value.get<std::string>(), name);
    validate(settings);
  } catch (const Error& error) {
    fail(ErrorKind::data, "{} (the checkpoint is of another version of this program)", error.what());
  }
}

struct Sizes {
  std::uint64_t values, moments, loss_sums, appearance, cameras;
};

Sizes read_header(const Json& h, Checkpoint& c, const std::string& name) {
  TrainState& s = c.state;
  s.model.dim = h.at("dim").get<int>();
  const auto& numbers = h.at("variant");
  std::array<int, kVariantSwitches.size()> variant{};
  if (numbers.size() != variant.size())
    fail(ErrorKind::data, "{}: the checkpoint knows {} switches of the method, this program {}", name,
         numbers.size(), variant.size());
  for (std::size_t i = 0; i < variant.size(); ++i) variant[i] = numbers[i].get<int>();
  s.model.variant = variant_from_numbers(variant);
  s.model.count = h.at("splats").get<std::size_t>();
  s.iteration = h.at("iteration").get<int>();
  s.logged = h.at("logged").get<int>();
  s.adam_steps = h.at("adam_steps").get<std::uint64_t>();
  s.seconds = h.at("seconds").get<double>();
  s.skipped_draws = h.at("skipped_draws").get<std::set<std::uint64_t>>();
  s.rollbacks = h.at("rollbacks").get<int>();
  s.dropped = h.at("dropped").get<std::uint64_t>();
  c.data = h.at("data").get<std::string>();
  c.data_print = h.at("data_print").get<std::uint32_t>();
  c.device = h.at("device").get<std::string>();
  c.build = h.at("build").get<std::string>();
  c.planned_seconds = h.at("planned_seconds").get<double>();
  read_settings(h.at("settings"), c.settings, name);
  return {h.at("values").get<std::uint64_t>(), h.at("moments").get<std::uint64_t>(),
          h.at("loss_sums").get<std::uint64_t>(), h.value("appearance", std::uint64_t{0}),
          h.value("cameras", std::uint64_t{0})};
}

void check_sizes(const Checkpoint& c, const Sizes& sizes, const std::string& name) {
  const TrainState& s = c.state;
  const bool fits = s.model.dim == c.settings.dim && s.model.variant == c.settings.variant &&
                    s.model.count > 0 && s.model.count <= 0xffffff00u && s.iteration >= 0 && s.logged >= 0 &&
                    s.logged <= s.iteration && s.iteration <= c.settings.iterations &&
                    sizes.values == static_cast<std::uint64_t>(s.model.layout().count) * s.model.count &&
                    sizes.moments % s.model.count == 0 && sizes.moments <= sizes.values;
  if (!fits) fail(ErrorKind::data, "{}: the numbers in the checkpoint's header contradict each other", name);
}

std::uint32_t add_to(std::uint32_t crc, const auto& value) {
  return crc32(std::as_bytes(std::span(&value, 1)), crc);
}

std::uint32_t add_camera(std::uint32_t crc, const Camera& c) {
  crc = crc32(std::as_bytes(std::span(c.rotation)), crc);
  crc = crc32(std::as_bytes(std::span(c.translation)), crc);
  for (const double value : {c.fx, c.fy, c.cx, c.cy, c.time}) crc = add_to(crc, value);
  for (const int value : {c.width, c.height}) crc = add_to(crc, value);
  return crc32(std::as_bytes(std::span(c.extra)), crc);
}

}  // namespace

bool is_finite(const TrainState& state) {
  const auto finite = [](const auto& values) {
    return std::ranges::all_of(values, [](auto v) { return std::isfinite(v); });
  };
  return finite(state.model.values) && finite(state.moment1) && finite(state.moment2) &&
         finite(state.appearance) && finite(state.cameras);
}

void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint) {
  if (!is_finite(checkpoint.state))
    fail(ErrorKind::numerical, "{}: not written: the state of iteration {} is not finite", path.string(),
         checkpoint.state.iteration);
  const std::string header = json_text(header_of(checkpoint));
  Writer writer(path);
  writer.bytes(std::as_bytes(std::span(kCheckpointMagic)));
  writer.word(kCheckpointVersion);
  writer.word(static_cast<std::uint32_t>(header.size()));
  writer.bytes(std::as_bytes(std::span(header)));
  writer.numbers(checkpoint.state.model.values);
  writer.numbers(checkpoint.state.moment1);
  writer.numbers(checkpoint.state.moment2);
  writer.numbers(checkpoint.state.loss_sums);
  writer.numbers(checkpoint.state.appearance);
  writer.numbers(checkpoint.state.cameras);
  writer.commit();
}

Checkpoint read_checkpoint(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::vector<std::byte> content = read_file(path);
  if (content.size() < kFixedBytes ||
      std::memcmp(content.data(), kCheckpointMagic.data(), kCheckpointMagic.size()) != 0)
    fail(ErrorKind::data, "{}: is no checkpoint of ubs train", name);
  Reader reader(content, name);
  reader.bytes(kCheckpointMagic.size());
  if (const std::uint32_t version = reader.word(); version != kCheckpointVersion)
    fail(ErrorKind::data, "{}: checkpoint of version {}; this program reads version {}", name, version,
         kCheckpointVersion);
  Checkpoint checkpoint;
  Sizes sizes{};
  const std::span<const std::byte> header = reader.bytes(reader.word());
  const std::string_view text(reinterpret_cast<const char*>(header.data()), header.size());
  const Json json = parse_own_json(text, name + ": damaged checkpoint: header");
  try {
    sizes = read_header(json, checkpoint, name);
  } catch (const nlohmann::json::exception&) {
    fail(ErrorKind::data, "{}: damaged checkpoint: its header is not one of ours", name);
  }
  check_sizes(checkpoint, sizes, name);
  TrainState& s = checkpoint.state;
  reader.numbers(s.model.values, sizes.values);
  reader.numbers(s.moment1, sizes.moments);
  reader.numbers(s.moment2, sizes.moments);
  reader.numbers(s.loss_sums, sizes.loss_sums);
  reader.numbers(s.appearance, sizes.appearance);
  reader.numbers(s.cameras, sizes.cameras);
  const std::uint32_t expected = crc32(std::span(content).first(content.size() - reader.left()));
  if (reader.word() != expected)
    fail(ErrorKind::data, "{}: damaged checkpoint: the CRC-32 does not match", name);
  if (reader.left() > 0)
    fail(ErrorKind::data, "{}: damaged checkpoint: {} bytes too many", name, reader.left());
  if (!is_finite(s)) fail(ErrorKind::data, "{}: the checkpoint holds values that are not finite", name);
  return checkpoint;
}

std::uint32_t fingerprint(const Split& split) {
  std::uint32_t crc = add_to(0, split.views.size());
  for (const View& view : split.views) {
    crc = crc32(std::as_bytes(std::span(view.name)), add_to(crc, view.name.size()));
    crc = add_camera(crc, view.camera);
  }
  const std::size_t views = split.views.size();
  for (const std::size_t i : std::set<std::size_t>{0, views / 2, views - std::min<std::size_t>(views, 1)})
    if (i < views && split.views[i].has_image()) {
      const Image8 image = split.views[i].load_image();
      crc = crc32(std::as_bytes(std::span(image.mask)), crc32(std::as_bytes(std::span(image.rgb)), crc));
    }
  return crc;
}

void check_same_settings(const TrainSettings& stored, const TrainSettings& wanted) {
  TrainSettings a = stored, b = wanted;
  const auto before = bind_fields(a, train_fields()), now = bind_fields(b, train_fields());
  for (std::size_t i = 0; i < before.size(); ++i) {
    const std::string old_text = field_text(before[i]), new_text = field_text(now[i]);
    if (old_text == new_text || (before[i].uses & kFreeOnResume)) continue;
    if (std::string_view(before[i].key) == "iterations")
      fail(ErrorKind::usage,
           "iterations = {} cannot continue a run of iterations = {}: the schedule scales with it, so its "
           "start would "
           "have been another one; start a new run",
           new_text, old_text);
    fail(ErrorKind::usage, "{} = {} cannot continue a run with {} = {}: leave it out, or start a new run",
         before[i].key, new_text, before[i].key, old_text);
  }
}

}  // namespace ubs
