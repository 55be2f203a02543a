// SPDX-License-Identifier: Apache-2.0
// See ubsz.hpp. A value is centre + (step 2^k) code, where k is the class of the splat. It is computed in
// double precision in this order and then rounded to float32, so that readers in other languages get
// bit-identical values.
#include "host/formats/ubsz.hpp"

#include <zlib.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>

#include "host/base/byte_reader.hpp"
#include "host/base/crc32.hpp"
#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/json.hpp"
#include "host/base/text.hpp"
#include "host/formats/foreign_formats.hpp"

namespace ubs {
namespace {

constexpr std::uint32_t kOneLevelVersion = 1, kLevelsVersion = 2;
// Bits of a position per axis. The code of all three axes together is a number that a double can represent
// exactly. Half of the codes are on either side of the centre.
constexpr int kPlaceBits = 17;
// Up to this number of steps from the centre, positions are stored in whole steps. Beyond it, each doubling
// of the distance doubles the step. Such distances occur because every trained model has stray splats, and
// surroundings that are a hundred times as far away as the rest.
constexpr std::int64_t kNearSteps = 8192;
constexpr double kFarSteps = 1 << 27;  // maximum distance [steps] that can be encoded
constexpr std::size_t kClasses = kMaxStepClass + 1;
// A plane with fewer bytes than this shares its Huffman code with neighbouring planes, because a separate
// code takes about 60 bytes, which is more than it would save.
constexpr std::size_t kOwnCode = 1500;

// RowCode describes the encoding of a row of parameters. If `bytes` is 4, the row is stored as float32
// values. Otherwise it is stored as codes relative to `centre` in units of `step`, with `bytes` bytes each.
struct RowCode {
  int bytes = 4;
  double centre = 0, step = 0;
};

struct GroupCode {
  int dim = 3;
  std::size_t count = 0;
  bool exact = true;
  std::array<std::size_t, kClasses> classes{};  // number of splats of each class, in file order
  double centre[3] = {}, place_step = 0;        // centre and quantisation step of the positions
  int place_bytes = 0;                          // bytes of the code of a position (all three axes)
  std::vector<RowCode> rows;                    // encodings of the rows after the positions
};

std::uint64_t gather_bits(std::uint64_t v) {
  std::uint64_t out = 0;
  for (int b = 0; b < kPlaceBits; ++b) out |= (v >> 3 * b & 1) << b;
  return out;
}

// Encodes a coordinate, which is in steps from the centre. far_steps() decodes it: it returns the middle of
// the interval that the code represents.
std::int64_t far_code(std::int64_t steps) {
  const std::int64_t size = std::abs(steps);
  if (size < kNearSteps) return steps;
  const int e = static_cast<int>(std::bit_width(static_cast<std::uint64_t>(size))) - 13;
  const std::int64_t code = kNearSteps / 2 * (e + 1) + (size >> e) - kNearSteps / 2;
  return steps < 0 ? -code : code;
}
double far_steps(std::int64_t code) {
  const std::int64_t size = std::abs(code), beyond = size - kNearSteps;
  if (beyond < 0) return static_cast<double>(code);
  const int e = static_cast<int>(beyond / (kNearSteps / 2)) + 1;
  const double middle = std::ldexp(static_cast<double>(kNearSteps / 2 + beyond % (kNearSteps / 2)) + 0.5, e);
  return code < 0 ? -middle : middle;
}

std::uint32_t zigzag(std::int64_t v) { return static_cast<std::uint32_t>(v < 0 ? -2 * v - 1 : 2 * v); }
std::int64_t unzigzag(std::uint32_t v) {
  return v & 1 ? -static_cast<std::int64_t>(v / 2) - 1 : static_cast<std::int64_t>(v / 2);
}

double code_value(double centre, double step, double code) { return centre + step * code; }

// PlaneWriter compresses planes with gzip. The data are mostly noise without repeated strings, so a strategy
// is used that relies on Huffman codes. Long planes get separate Huffman codes.
class PlaneWriter {
 public:
  PlaneWriter() {
    if (deflateInit2(&stream_, 9, Z_DEFLATED, 15 + 16, 9, Z_FILTERED) != Z_OK)
      fail(ErrorKind::memory, "zlib cannot be initialised");
  }
  ~PlaneWriter() { deflateEnd(&stream_); }
  PlaneWriter(const PlaneWriter&) = delete;

  void put(std::span<const std::byte> plane) { push(plane, plane.size() >= kOwnCode ? Z_BLOCK : Z_NO_FLUSH); }
  std::vector<std::byte> finish() {
    push({}, Z_FINISH);
    return std::move(out_);
  }

 private:
  void push(std::span<const std::byte> plane, int flush) {
    stream_.next_in = reinterpret_cast<Bytef*>(const_cast<std::byte*>(plane.data()));
    stream_.avail_in = static_cast<uInt>(plane.size());
    do {
      const std::size_t used = out_.size();
      out_.resize(used + 65536);
      stream_.next_out = reinterpret_cast<Bytef*>(out_.data() + used);
      stream_.avail_out = 65536;
      deflate(&stream_, flush);
      out_.resize(out_.size() - stream_.avail_out);
    } while (stream_.avail_out == 0);
  }
  z_stream stream_{};
  std::vector<std::byte> out_;
};

// Writes the lowest bytes of all values, then the next bytes, and so on.
template <typename T>
void put_planes(PlaneWriter& out, std::span<const T> values, int bytes) {
  std::vector<std::byte> plane(values.size());
  for (int b = 0; b < bytes; ++b) {
    for (std::size_t i = 0; i < values.size(); ++i) plane[i] = static_cast<std::byte>(values[i] >> 8 * b);
    out.put(plane);
  }
}
template <typename T>
std::vector<T> take_planes(ByteReader& in, std::size_t count, int bytes) {
  std::vector<T> values(count);
  for (int b = 0; b < bytes; ++b) {
    const auto plane = in.take(count);
    for (std::size_t i = 0; i < count; ++i)
      values[i] |= static_cast<T>(static_cast<std::uint8_t>(plane[i])) << 8 * b;
  }
  return values;
}

int bytes_for(std::uint64_t most) { return most < 256 ? 1 : most < 65536 ? 2 : 3; }

std::uint64_t place_code(const SplatModel& model, const GroupCode& group, std::size_t splat, double step) {
  std::uint64_t code = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const std::int64_t at = far_code(std::llround((model.row(axis)[splat] - group.centre[axis]) / step));
    code |= spread_bits(static_cast<std::uint64_t>(at + (1 << (kPlaceBits - 1)))) << axis;
  }
  return code;
}

double middle_of(std::span<const float> row) {
  if (row.empty()) return 0;
  std::vector<float> sorted(row.begin(), row.end());
  std::ranges::nth_element(sorted, sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2));
  return sorted[sorted.size() / 2];
}

// Returns the encoding of a row. If the codes would not fit into three bytes, the step is ignored and the row
// is stored exactly.
RowCode row_code(std::span<const float> row, double step, std::span<const std::uint8_t> classes) {
  RowCode code;
  code.centre = middle_of(row);
  code.step = step;
  double most = 0;
  for (std::size_t i = 0; i < row.size(); ++i)
    most = std::max(most, std::abs(row[i] - code.centre) / (step * (1 << classes[i])));
  if (!(most < (1 << 23) - 2)) return {};
  code.bytes = bytes_for(2 * static_cast<std::uint64_t>(std::ceil(most)) + 1);
  return code;
}

// Determines how a group is encoded, and the order of its splats. They are sorted by class, and within a
// class along a space-filling curve.
GroupCode plan_group(const SplatModel& model, const UbszSteps& steps, std::vector<std::size_t>& order) {
  GroupCode group{.dim = model.dim, .count = model.count, .exact = false};
  const ParameterLayout layout = model.layout();
  if (steps.steps.size() != static_cast<std::size_t>(layout.count) || steps.classes.size() != model.count ||
      std::ranges::any_of(steps.classes, [](int k) { return k > kMaxStepClass; }) ||
      std::ranges::any_of(steps.steps, [](double s) { return !(s > 0); }))
    fail(ErrorKind::internal, "the quantisation steps do not match the model");
  for (const std::uint8_t k : steps.classes) ++group.classes[k];
  double extent = 0;
  for (int axis = 0; axis < 3; ++axis) {
    group.centre[axis] = middle_of(model.row(axis));
    for (const float v : model.row(axis)) extent = std::max(extent, std::abs(v - group.centre[axis]));
  }
  // If positions are too far apart for their step, use the finest step that reaches them.
  group.place_step = std::max(steps.steps[0], extent / (kFarSteps - 2));
  std::vector<std::uint64_t> places(model.count);
  std::uint64_t most = 0;
  for (std::size_t i = 0; i < model.count; ++i) {
    places[i] = place_code(model, group, i, group.place_step * (1 << steps.classes[i]));
    most = std::max(most, places[i]);
  }
  group.place_bytes = std::max(1, (static_cast<int>(std::bit_width(most)) + 7) / 8);
  order.resize(model.count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
    return std::pair(steps.classes[a], places[a]) < std::pair(steps.classes[b], places[b]);
  });
  for (int r = 3; r < layout.count; ++r)
    group.rows.push_back(row_code(model.row(r), steps.steps[static_cast<std::size_t>(r)], steps.classes));
  return group;
}

Json group_json(const GroupCode& group) {
  Json json{{"dim", group.dim}, {"splats", group.count}};
  if (group.exact) return json;
  json["classes"] = group.classes;
  json["places"] = {{"centre", group.centre}, {"step", group.place_step}, {"bytes", group.place_bytes}};
  for (const RowCode& row : group.rows)
    json["rows"].push_back({{"bytes", row.bytes}, {"centre", row.centre}, {"step", row.step}});
  return json;
}

// Writes the classes one after the other. For each class, writes the differences between successive
// positions, and then the other parameters row by row.
void put_group(PlaneWriter& out, const SplatModel& model, const GroupCode& group,
               const std::vector<std::size_t>& order) {
  const ParameterLayout layout = model.layout();
  if (group.exact) {
    for (int r = 0; r < layout.count; ++r) {
      std::vector<std::uint32_t> bits(model.count);
      std::memcpy(bits.data(), model.row(r).data(), 4 * model.count);
      put_planes<std::uint32_t>(out, bits, 4);
    }
    return;
  }
  std::size_t first = 0;
  for (std::size_t k = 0; k < kClasses; ++k) {
    const auto part = std::span(order).subspan(first, group.classes[k]);
    first += part.size();
    const double times = 1 << k;
    std::vector<std::uint64_t> places;
    std::uint64_t before = 0;
    for (const std::size_t i : part) {
      const std::uint64_t code = place_code(model, group, i, group.place_step * times);
      places.push_back(code - before);
      before = code;
    }
    put_planes<std::uint64_t>(out, places, group.place_bytes);
    for (std::size_t r = 0; r < group.rows.size(); ++r) {
      const RowCode& row = group.rows[r];
      const auto values = model.row(static_cast<int>(r) + 3);
      std::vector<std::uint32_t> codes;
      for (const std::size_t i : part)
        codes.push_back(row.bytes == 4 ? std::bit_cast<std::uint32_t>(values[i])
                                       : zigzag(std::llround((values[i] - row.centre) / (row.step * times))));
      put_planes<std::uint32_t>(out, codes, row.bytes);
    }
  }
}

void take_group(ByteReader& in, const GroupCode& group, SplatModel& model) {
  if (group.exact) {
    for (int r = 0; r < model.layout().count; ++r) {
      const auto bits = take_planes<std::uint32_t>(in, model.count, 4);
      std::memcpy(model.row(r).data(), bits.data(), 4 * model.count);
    }
    return;
  }
  std::size_t first = 0;
  for (std::size_t k = 0; k < kClasses; ++k) {
    const std::size_t n = group.classes[k];
    const double times = 1 << k;
    const auto places = take_planes<std::uint64_t>(in, n, group.place_bytes);
    std::uint64_t code = 0;
    for (std::size_t i = 0; i < n; ++i) {
      code += places[i];
      for (int axis = 0; axis < 3; ++axis)
        model.row(axis)[first + i] = static_cast<float>(code_value(
            group.centre[axis], group.place_step * times,
            far_steps(static_cast<std::int64_t>(gather_bits(code >> axis)) - (1 << (kPlaceBits - 1)))));
    }
    for (std::size_t r = 0; r < group.rows.size(); ++r) {
      const RowCode& row = group.rows[r];
      const auto codes = take_planes<std::uint32_t>(in, n, row.bytes);
      for (std::size_t i = 0; i < n; ++i)
        model.row(static_cast<int>(r) + 3)[first + i] =
            row.bytes == 4 ? std::bit_cast<float>(codes[i])
                           : static_cast<float>(code_value(row.centre, row.step * times,
                                                           static_cast<double>(unzigzag(codes[i]))));
    }
    first += n;
  }
}

void require_finite(const MixedModel& model, ErrorKind kind, const std::string& name) {
  for (const SplatModel& group : model.groups)
    if (!std::ranges::all_of(group.values, [](float v) { return std::isfinite(v); }))
      fail(kind, "{}: a value of a splat with N = {} is not finite", name, group.dim);
}

// ---- Reading the header of a file; unexpected contents are reported as damage ----

// Returns a count. Throws for fractions and negative numbers, because the JSON library would convert them
// without an error.
std::size_t count_of(const Json& value) {
  if (!value.is_number_unsigned())
    fail(ErrorKind::data, "the header has the value {} where a count is expected",
         shortened(json_text(value)));
  return value.get<std::size_t>();
}

// Returns a count that is valid only if it is small. Counts above 1000 become 1000, so that the conversion to
// int cannot turn an invalid count into a valid one.
int small_count_of(const Json& value) {
  return static_cast<int>(std::min<std::size_t>(count_of(value), 1000));
}

GroupCode group_of(const Json& json, const ModelVariant& variant, std::size_t room, std::size_t& plain) {
  GroupCode group;
  group.dim = small_count_of(json.at("dim"));
  group.count = count_of(json.at("splats"));
  group.exact = !json.contains("rows");
  const ParameterLayout layout(group.dim, variant);
  std::size_t bytes = 4 * static_cast<std::size_t>(layout.count);
  if (!group.exact) {
    const Json& classes = json.at("classes");
    if (classes.size() != kClasses)
      fail(ErrorKind::data, "the header has an unexpected number of classes: {}", classes.size());
    for (std::size_t k = 0; k < kClasses; ++k) group.classes[k] = count_of(classes[k]);
    const Json& places = json.at("places");
    const auto centre = places.at("centre").get<std::array<double, 3>>();
    std::ranges::copy(centre, group.centre);
    group.place_step = places.at("step").get<double>();
    group.place_bytes = small_count_of(places.at("bytes"));
    for (const Json& row : json.at("rows"))
      group.rows.push_back(
          {small_count_of(row.at("bytes")), row.at("centre").get<double>(), row.at("step").get<double>()});
    bytes = static_cast<std::size_t>(group.place_bytes);
    for (const RowCode& row : group.rows) bytes += static_cast<std::size_t>(row.bytes);
    // Subtract the classes from the number of splats, because their sum could overflow.
    std::size_t rest = group.count;
    for (const std::size_t n : group.classes) {
      if (n > rest) fail(ErrorKind::data, "the classes contain more splats than the group");
      rest -= n;
    }
    if (rest > 0 || group.rows.size() + 3 != static_cast<std::size_t>(layout.count) ||
        group.place_bytes < 1 || group.place_bytes > 7 ||
        std::ranges::any_of(group.rows, [](const RowCode& row) { return row.bytes < 1 || row.bytes > 4; }))
      fail(ErrorKind::data, "the rows or classes of the group with N = {} are not valid", group.dim);
  }
  if (group.count > room / bytes)
    fail(ErrorKind::data, "the group has more splats than the file can contain");
  plain += group.count * bytes;
  return group;
}

}  // namespace

SplatModel rounded(const SplatModel& model, const UbszSteps& steps) {
  return unpack_ubsz(pack_ubsz(model, {}, std::span(&steps, 1)), "rounded model").groups.front();
}

namespace {

// Returns the header entries of the groups of a model, and appends their planes to `packed`.
Json pack_groups(const MixedModel& model, std::span<const UbszSteps> steps, std::vector<std::byte>& packed) {
  check_groups(model);
  require_finite(model, ErrorKind::numerical, "the model is not written");
  Json groups = Json::array();
  PlaneWriter planes;
  for (std::size_t g = 0; g < model.groups.size(); ++g) {
    const SplatModel& splats = model.groups[g];
    std::vector<std::size_t> order;
    const GroupCode group = steps.empty() ? GroupCode{.dim = splats.dim, .count = splats.count}
                                          : plan_group(splats, steps[g], order);
    groups.push_back(group_json(group));
    put_group(planes, splats, group, order);
  }
  packed = planes.finish();
  return groups;
}

Json ubsz_header(const MixedModel& model, std::span<const std::string> comments) {
  Json header{{"switches", Json::object()}, {"comments", comments}};
  for (const auto& [key, value] : non_default_switches(model.variant())) header["switches"][key] = value;
  return header;
}

std::vector<std::byte> ubsz_head(std::uint32_t version, const Json& header) {
  const std::string text = json_text(header);
  const auto words = std::as_bytes(std::span(text));
  std::vector<std::byte> out;
  for (const char c : kUbszMagic) out.push_back(static_cast<std::byte>(c));
  for (const std::uint32_t v : {version, static_cast<std::uint32_t>(text.size()), crc32(words)})
    put_number(out, v);
  out.insert(out.end(), words.begin(), words.end());
  return out;
}

SplatModel joined(const SplatModel& a, const SplatModel& b) {
  SplatModel out(a.dim, a.count + b.count, a.variant);
  for (int r = 0; r < a.layout().count; ++r) {
    std::ranges::copy(a.row(r), out.row(r).begin());
    std::ranges::copy(b.row(r), out.row(r).begin() + static_cast<std::ptrdiff_t>(a.count));
  }
  return out;
}

// Joins groups of the same dimension, in the order in which the dimensions first appear. Neighbouring groups
// are joined in pairs until one group is left. If the levels were joined one after the other instead, the
// splats of the first levels would be copied again for each further level.
void join_groups(std::vector<SplatModel>& groups) {
  std::vector<std::vector<SplatModel>> parts;
  for (SplatModel& group : groups) {
    auto same = std::ranges::find(parts, group.dim, [](const auto& list) { return list.front().dim; });
    if (same == parts.end()) same = parts.emplace(parts.end());
    same->push_back(std::move(group));
  }
  groups.clear();
  for (std::vector<SplatModel>& list : parts) {
    while (list.size() > 1) {
      std::vector<SplatModel> pairs;
      for (std::size_t i = 0; i + 1 < list.size(); i += 2) pairs.push_back(joined(list[i], list[i + 1]));
      if (list.size() % 2 == 1) pairs.push_back(std::move(list.back()));
      list = std::move(pairs);
    }
    groups.push_back(std::move(list.front()));
  }
}

// Decodes the groups of a header and adds them to the model.
void unpack_groups(const Json& json, std::span<const std::byte> packed, const ModelVariant& variant,
                   const std::string& name, MixedModel& model) {
  std::vector<GroupCode> groups;
  std::size_t plain = 0;
  for (const Json& group : json)
    groups.push_back(group_of(group, variant, kMaxDeflateRatio * packed.size(), plain));
  const std::vector<std::byte> payload = inflate_gzip(packed, plain + 1, name);
  if (payload.size() != plain)
    fail(ErrorKind::data, "the parameters have {} bytes, but the header announces {}", payload.size(), plain);
  ByteReader parameters(payload, name);
  for (const GroupCode& code : groups) {
    SplatModel part(code.dim, code.count, variant);
    take_group(parameters, code, part);
    model.groups.push_back(std::move(part));
  }
}

}  // namespace

std::vector<std::byte> pack_ubsz(const MixedModel& model, std::span<const std::string> comments,
                                 std::span<const UbszSteps> steps) {
  std::vector<std::byte> packed;
  Json header = ubsz_header(model, comments);
  header["groups"] = pack_groups(model, steps, packed);
  std::vector<std::byte> out = ubsz_head(kOneLevelVersion, header);
  out.insert(out.end(), packed.begin(), packed.end());
  return out;
}

UbszParts pack_ubsz_levels(std::span<const UbszLevel> levels, std::span<const std::string> comments) {
  Json header = ubsz_header(levels.front().model, comments);
  std::vector<std::byte> planes;
  UbszParts out;
  for (const UbszLevel& level : levels) {
    std::vector<std::byte> packed;
    Json groups = pack_groups(level.model, level.steps, packed);
    header["levels"].push_back(
        {{"bytes", packed.size()}, {"psnr", level.psnr}, {"groups", std::move(groups)}});
    planes.insert(planes.end(), packed.begin(), packed.end());
    out.sizes.push_back(packed.size());
  }
  out.bytes = ubsz_head(kLevelsVersion, header);
  out.sizes[0] += out.bytes.size();
  out.bytes.insert(out.bytes.end(), planes.begin(), planes.end());
  return out;
}

MixedModel unpack_ubsz(std::span<const std::byte> bytes, const std::string& name,
                       std::vector<std::string>* comments) {
  ByteReader in(bytes, name);
  if (bytes.size() < 16 || std::memcmp(in.take(4).data(), kUbszMagic, 4) != 0)
    fail(ErrorKind::data, "{}: not a UBSZ file", name);
  const auto version = in.read<std::uint32_t>();
  if (version != kOneLevelVersion && version != kLevelsVersion)
    fail(ErrorKind::data, "{}: UBSZ version {} is not supported, only {} and {}", name, version,
         kOneLevelVersion, kLevelsVersion);
  const auto size = in.read<std::uint32_t>(), crc = in.read<std::uint32_t>();
  const auto words = in.take(size);
  if (crc32(words) != crc) fail(ErrorKind::data, "{}: the header is damaged", name);
  MixedModel model{std::vector<SplatModel>{}};
  try {
    const Json header = parse_own_json({reinterpret_cast<const char*>(words.data()), words.size()}, name);
    ModelVariant variant;
    for (const auto& [key, value] : header.at("switches").items())
      set_switch(variant, key, value.get<std::string>(), name);
    if (comments) *comments = header.at("comments").get<std::vector<std::string>>();
    if (version == kOneLevelVersion) {
      unpack_groups(header.at("groups"), in.take(in.remaining()), variant, name, model);
    } else {
      for (const Json& level : header.at("levels"))
        unpack_groups(level.at("groups"), in.take(count_of(level.at("bytes"))), variant, name, model);
      if (in.remaining() > 0) fail(ErrorKind::data, "{} bytes follow the last level", in.remaining());
      join_groups(model.groups);
    }
  } catch (const nlohmann::json::exception& error) {
    fail(ErrorKind::data, "{}: the header does not match the format: {}", name, error.what());
  } catch (const Error& error) {
    if (std::string_view(error.what()).starts_with(name)) throw;
    fail(ErrorKind::data, "{}: {}", name, error.what());
  }
  try {
    check_groups(model);
  } catch (const Error& error) {
    fail(ErrorKind::data, "{}: {}", name, error.what());
  }
  require_finite(model, ErrorKind::data, name);
  return model;
}

MixedModel read_ubsz(const std::filesystem::path& path, std::vector<std::string>* comments) {
  return unpack_ubsz(read_file(path), path.string(), comments);
}

}  // namespace ubs
