// SPDX-License-Identifier: Apache-2.0
#include "host/train/checkpoint.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <optional>

#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/settings/fields.hpp"

namespace ubs {
namespace {

constexpr std::string_view kCheckpointMagic = "UBSCKPT\n";
constexpr std::uint32_t kCheckpointVersion = 3;
constexpr std::size_t kFixedBytes = 16;  // magic, version, header bytes
static_assert(std::endian::native == std::endian::little, "checkpoints require a little-endian machine");

Json settings_json(TrainSettings settings) {
  Json json = Json::object();
  for (const FieldValue& field : bind_fields(settings, train_fields())) json[field.key] = field_text(field);
  return json;
}

Json budget_json(const TimeBudget& budget) {
  if (budget.seconds <= 0) return nullptr;
  Json costs = Json::array();
  for (const StepCost& cost : budget.costs)
    costs.push_back({{"factor", cost.factor},
                     {"fixed_ms", cost.fixed_ms},
                     {"each_ms", cost.each_ms},
                     {"sweep_ms", cost.sweep_ms}});
  return {{"seconds", budget.seconds},
          {"spent", budget.spent},
          {"most_iterations", budget.most_iterations},
          {"first_iterations", budget.first_iterations},
          {"costs", costs}};
}

TimeBudget read_budget(const Json& json) {
  TimeBudget budget;
  json.at("seconds").get_to(budget.seconds);
  json.at("spent").get_to(budget.spent);
  json.at("most_iterations").get_to(budget.most_iterations);
  json.at("first_iterations").get_to(budget.first_iterations);
  for (const Json& cost : json.at("costs"))
    budget.costs.push_back({cost.at("factor").get<int>(), cost.at("fixed_ms").get<double>(),
                            cost.at("each_ms").get<double>(), cost.at("sweep_ms").get<double>()});
  return budget;
}

// Sizes holds the number of elements of each part of a state.
struct Sizes {
  std::uint64_t values, moments, loss_sums, appearance, sky, cameras;
};

Json header_of(const Checkpoint& c, std::uint64_t splats, const Sizes& sizes) {
  const TrainState& s = c.state;
  Json variant = Json::array();
  for (const int number : variant_numbers(s.model.variant)) variant.push_back(number);
  return {{"dim", s.model.dim},
          {"variant", variant},
          {"splats", splats},
          {"values", sizes.values},
          {"moments", sizes.moments},
          {"loss_sums", sizes.loss_sums},
          {"appearance", sizes.appearance},
          {"sky", sizes.sky},
          {"cameras", sizes.cameras},
          {"iteration", s.iteration},
          {"logged", s.logged},
          {"adam_steps", s.adam_steps},
          {"seconds", s.seconds},
          {"skipped_draws", s.skipped_draws},
          {"rollbacks", s.rollbacks},
          {"dropped", s.dropped},
          {"data", c.data},
          {"data_from_run", c.data_from_run},
          {"data_print", c.data_print},
          {"device", c.device},
          {"build", c.build},
          {"views_by_rank", c.views_by_rank},
          {"budget", budget_json(c.budget)},
          {"first_row", c.first_row},
          {"settings", settings_json(c.settings)}};
}

// Reader reads the content of a file from front to back.
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
      fail(ErrorKind::data,
           "{}: truncated checkpoint: {} numbers of {} bytes are expected, but only {} bytes are left", name_,
           count, sizeof(T), rest_.size());
    to.resize(count);
    const auto piece = bytes(count * sizeof(T));
    if (count > 0) std::memcpy(to.data(), piece.data(), piece.size());
  }
  std::size_t left() const { return rest_.size(); }

 private:
  std::span<const std::byte> rest_;
  std::string name_;
};

void read_settings(const Json& json, Checkpoint& c, const std::string& name) {
  const std::vector<FieldValue> fields = bind_fields(c.settings, train_fields());
  try {
    for (const auto& [key, value] : json.items()) {
      std::string in_file = set_field_from_run(fields, key, value.get<std::string>(), name);
      const auto field = std::ranges::find(fields, key, [](const FieldValue& f) { return f.key; });
      if (field_text(*field) != in_file) c.unused_settings.emplace_back(key, std::move(in_file));
    }
    validate(c.settings);
  } catch (const Error& error) {
    fail(ErrorKind::data, "{} (the checkpoint was written by another version of this program)", error.what());
  }
}

Sizes read_header(const Json& h, Checkpoint& c, const std::string& name) {
  TrainState& s = c.state;
  s.model.dim = h.at("dim").get<int>();
  const auto& numbers = h.at("variant");
  std::array<int, kVariantSwitches.size()> variant{};
  if (numbers.size() != variant.size())
    fail(ErrorKind::data, "{}: the checkpoint has {} settings of the variant, but this program has {}", name,
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
  c.data_from_run = h.value("data_from_run", "");
  c.data_print = h.at("data_print").get<std::uint32_t>();
  c.device = h.at("device").get<std::string>();
  c.build = h.at("build").get<std::string>();
  c.views_by_rank = h.value("views_by_rank", std::vector<std::uint64_t>{});
  c.first_row = h.value("first_row", "");
  if (const Json& budget = h.at("budget"); !budget.is_null()) c.budget = read_budget(budget);
  read_settings(h.at("settings"), c, name);
  return {h.at("values").get<std::uint64_t>(),    h.at("moments").get<std::uint64_t>(),
          h.at("loss_sums").get<std::uint64_t>(), h.value("appearance", std::uint64_t{0}),
          h.value("sky", std::uint64_t{0}),       h.value("cameras", std::uint64_t{0})};
}

void check_sizes(const Checkpoint& c, const Sizes& sizes, const std::string& name) {
  const TrainState& s = c.state;
  const bool fits = s.model.dim == c.settings.dim && s.model.variant == c.settings.variant &&
                    s.model.count > 0 && s.model.count <= 0xffffff00u && s.iteration >= 0 && s.logged >= 0 &&
                    s.logged <= s.iteration && s.iteration <= c.settings.iterations &&
                    sizes.values == static_cast<std::uint64_t>(s.model.layout().count) * s.model.count &&
                    sizes.moments % s.model.count == 0 && sizes.moments <= sizes.values;
  if (!fits) fail(ErrorKind::data, "{}: the numbers in the header of the checkpoint are inconsistent", name);
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

// CheckedFile writes an AtomicFile that ends with the CRC-32 of its content.
class CheckedFile {
 public:
  explicit CheckedFile(const std::filesystem::path& path) : file_(path) {}
  template <typename Values>
  void write(const Values& values) {
    const auto bytes = std::as_bytes(std::span(values));
    file_.write(bytes);
    crc_ = crc32(bytes, crc_);
    size_ += bytes.size();
  }
  void write_word(std::uint32_t value) { write(std::array{value}); }
  // Skips bytes that another rank writes and that have this CRC-32.
  void skip(std::uint64_t bytes, std::uint32_t crc) {
    file_.skip(bytes);
    crc_ = crc32_joined(crc_, crc, bytes);
    size_ += bytes;
  }
  void commit() {
    write_word(crc_);
    file_.commit();
  }
  std::uint64_t size() const { return size_; }
  const std::filesystem::path& temporary() const { return file_.temporary(); }

 private:
  AtomicFile file_;
  std::uint64_t size_ = 0;
  std::uint32_t crc_ = 0;
};

// Steps runs the steps of a task that all ranks perform together. If a step fails on one rank, for example
// because a disk is full, it fails on all ranks.
class Steps {
 public:
  explicit Steps(Communicator& ranks) : ranks_(ranks) {}
  template <typename Work>
  void then(const Work& work) {
    std::string own;
    try {
      work();
    } catch (const std::exception& exception) {
      if (ranks_.size() == 1) throw;
      own = as_error(exception).what();
    }
    const std::vector<std::string> all = ranks_.all_texts(own);
    for (std::size_t r = 0; r < all.size(); ++r)
      if (!all[r].empty()) fail(ErrorKind::data, "rank {}: {}", r, all[r]);
  }

 private:
  Communicator& ranks_;
};

// Totals holds sums over the parts of all ranks.
struct Totals {
  std::uint64_t splats, values, moments;
  std::uint64_t before;  // number of splats that the ranks before this one hold
};

std::uint64_t splats_before(Communicator& ranks, std::uint64_t count) {
  std::vector<std::uint64_t> counts(static_cast<std::size_t>(ranks.size()));
  counts[static_cast<std::size_t>(ranks.rank())] = count;
  ranks.sum(counts);
  return std::accumulate(counts.begin(), counts.begin() + ranks.rank(), std::uint64_t{0});
}

// RowPart describes the part of one row that a rank has written: its size and its CRC-32.
struct RowPart {
  std::uint64_t bytes, crc;
};

// Writes the parameters and moments of this rank's splats, row by row.
std::vector<RowPart> write_rows(const std::filesystem::path& temporary, std::uint64_t begin,
                                const TrainState& s, const Totals& all) {
  PartOfFile part(temporary);
  std::vector<RowPart> written;
  std::uint64_t row = 0;
  for (const auto& [values, rows] : {std::pair{&s.model.values, all.values / all.splats},
                                     {&s.moment1, all.moments / all.splats},
                                     {&s.moment2, all.moments / all.splats}})
    for (std::uint64_t r = 0; r < rows; ++r, ++row) {
      const auto bytes = std::as_bytes(std::span(*values).subspan(r * s.model.count, s.model.count));
      part.write(begin + (row * all.splats + all.before) * sizeof(float), bytes);
      written.push_back({bytes.size(), crc32(bytes)});
    }
  part.sync();
  return written;
}

}  // namespace

bool is_finite(const TrainState& state) {
  const auto finite = [](const auto& values) {
    return std::ranges::all_of(values, [](auto v) { return std::isfinite(v); });
  };
  return finite(state.model.values) && finite(state.moment1) && finite(state.moment2) &&
         finite(state.appearance) && finite(state.sky) && finite(state.cameras);
}

void write_checkpoint(const std::filesystem::path& path, const Checkpoint& checkpoint, Communicator& ranks) {
  const TrainState& s = checkpoint.state;
  std::array<std::uint64_t, 4> sums{is_finite(s) ? 0u : 1u, s.model.count, s.model.values.size(),
                                    s.moment1.size()};
  ranks.sum(sums);
  const std::uint64_t bad = sums[0], splats = sums[1], values = sums[2], moments = sums[3];
  if (bad > 0)
    fail(ErrorKind::numerical,
         "{}: the checkpoint is not written, because the state of iteration {} is not finite", path.string(),
         s.iteration);
  Steps steps(ranks);
  std::optional<CheckedFile> file;
  std::string place;
  std::uint64_t begin = 0;
  steps.then([&] {
    if (!ranks.first()) return;
    const std::string header = json_text(header_of(
        checkpoint, splats,
        {values, moments, s.loss_sums.size(), s.appearance.size(), s.sky.size(), s.cameras.size()}));
    file.emplace(path);
    file->write(kCheckpointMagic);
    file->write_word(kCheckpointVersion);
    file->write_word(static_cast<std::uint32_t>(header.size()));
    file->write(header);
    begin = file->size();
    if (ranks.size() > 1) place = std::filesystem::absolute(file->temporary()).string();
  });
  std::vector<Bytes> rows;  // for each rank, the parts of rows that it has written
  if (ranks.size() > 1) {
    place = ranks.all_texts(place).front();
    const Totals all{splats, values, moments, splats_before(ranks, s.model.count)};
    begin = ranks.of_first(begin);
    std::vector<std::vector<RowPart>> to_first(static_cast<std::size_t>(ranks.size()));
    steps.then([&] { to_first[0] = write_rows(place, begin, s, all); });
    rows = exchange_values(ranks, to_first);
  }
  steps.then([&] {
    if (!ranks.first()) return;
    if (rows.empty())
      for (const auto* part : {&s.model.values, &s.moment1, &s.moment2}) file->write(*part);
    else
      for (std::size_t row = 0; row < as_values<RowPart>(rows[0]).size(); ++row)
        for (const Bytes& of_rank : rows) {
          const RowPart part = as_values<RowPart>(of_rank)[row];
          file->skip(part.bytes, static_cast<std::uint32_t>(part.crc));
        }
    file->write(s.loss_sums);
    file->write(s.appearance);
    file->write(s.sky);
    file->write(s.cameras);
    file->commit();
  });
}

Checkpoint read_checkpoint(const std::filesystem::path& path) {
  const std::string name = path.string();
  const std::vector<std::byte> content = read_file(path);
  if (content.size() < kFixedBytes ||
      std::memcmp(content.data(), kCheckpointMagic.data(), kCheckpointMagic.size()) != 0)
    fail(ErrorKind::data, "{}: not a checkpoint of 'ubs train'", name);
  Reader reader(content, name);
  reader.bytes(kCheckpointMagic.size());
  if (const std::uint32_t version = reader.word(); version != kCheckpointVersion)
    fail(ErrorKind::data, "{}: the checkpoint has version {}, but this program reads version {}", name,
         version, kCheckpointVersion);
  Checkpoint checkpoint;
  Sizes sizes{};
  const std::span<const std::byte> header = reader.bytes(reader.word());
  const std::string_view text(reinterpret_cast<const char*>(header.data()), header.size());
  const Json json = parse_own_json(text, name + ": damaged checkpoint: header");
  try {
    sizes = read_header(json, checkpoint, name);
  } catch (const nlohmann::json::exception&) {
    fail(ErrorKind::data, "{}: damaged checkpoint: invalid header", name);
  }
  check_sizes(checkpoint, sizes, name);
  TrainState& s = checkpoint.state;
  reader.numbers(s.model.values, sizes.values);
  reader.numbers(s.moment1, sizes.moments);
  reader.numbers(s.moment2, sizes.moments);
  reader.numbers(s.loss_sums, sizes.loss_sums);
  reader.numbers(s.appearance, sizes.appearance);
  reader.numbers(s.sky, sizes.sky);
  reader.numbers(s.cameras, sizes.cameras);
  const std::uint32_t expected = crc32(std::span(content).first(content.size() - reader.left()));
  if (reader.word() != expected)
    fail(ErrorKind::data, "{}: damaged checkpoint: the CRC-32 does not match", name);
  if (reader.left() > 0)
    fail(ErrorKind::data, "{}: damaged checkpoint: {} bytes follow the CRC-32", name, reader.left());
  if (!is_finite(s)) fail(ErrorKind::data, "{}: the checkpoint contains values that are not finite", name);
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
           "cannot resume with iterations = {}: the run was started with iterations = {}, and its schedule "
           "depends on that number: pass --budget +TIME for another length, or start a new run",
           new_text, old_text);
    fail(
        ErrorKind::usage,
        "cannot resume with {} = {}: the run was started with {} = {}: remove the option, or start a new run",
        before[i].key, new_text, before[i].key, old_text);
  }
}

}  // namespace ubs
