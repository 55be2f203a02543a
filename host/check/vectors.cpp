// SPDX-License-Identifier: Apache-2.0
#include "host/check/vectors.hpp"

#include <zlib.h>

#include <cstring>

#include "host/base/error.hpp"
#include "host/check/forms.hpp"

namespace ubs::check {
namespace {

constexpr std::uint64_t kMagic = 0x31766b6863736275;  // "ubschkv1"

// PackStream writes the values of Vectors. Large arrays are stored as float32. The bounds of the checks are
// larger than the rounding errors of this conversion.
class PackStream {
 public:
  template <class T>
  void number(const T& value) {
    const auto* at = reinterpret_cast<const std::byte*>(&value);
    bytes_.insert(bytes_.end(), at, at + sizeof value);
  }
  template <class Stored, class T>
  void array(const std::vector<T>& values, std::size_t size) {
    if (values.size() != size)
      fail(ErrorKind::internal, "the reference data of the device check have {} values instead of {}",
           values.size(), size);
    for (const T& value : values) number(static_cast<Stored>(value));
  }
  template <class T>
  void agree(const T& value) {
    number(value);
  }
  const std::vector<std::byte>& bytes() const { return bytes_; }

 private:
  std::vector<std::byte> bytes_;
};

// UnpackStream reads the values that PackStream has written, in the same order.
class UnpackStream {
 public:
  explicit UnpackStream(std::span<const std::byte> bytes) : rest_(bytes) {}
  template <class T>
  void number(T& value) {
    if (rest_.size() < sizeof value)
      fail(ErrorKind::internal, "the reference data of the device check are truncated");
    std::memcpy(&value, rest_.data(), sizeof value);
    rest_ = rest_.subspan(sizeof value);
  }
  template <class Stored, class T>
  void array(std::vector<T>& values, std::size_t size) {
    if (size > rest_.size() / sizeof(Stored))
      fail(ErrorKind::internal, "the reference data of the device check are truncated");
    values.resize(size);
    for (T& value : values) {
      Stored stored;
      number(stored);
      value = stored;
    }
  }
  template <class T>
  void agree(const T& value) {
    T found;
    number(found);
    if (found != value)
      fail(ErrorKind::internal, "the reference data of the device check belong to another build");
  }
  void end() const {
    if (!rest_.empty()) fail(ErrorKind::internal, "the reference data of the device check are too long");
  }

 private:
  std::span<const std::byte> rest_;
};

template <class Stream>
void pass_camera(Stream& s, Camera& camera) {
  for (double& x : camera.rotation) s.number(x);
  for (double& x : camera.translation) s.number(x);
  for (double* x : {&camera.fx, &camera.fy, &camera.cx, &camera.cy, &camera.time}) s.number(*x);
  s.number(camera.width);
  s.number(camera.height);
  std::uint64_t count = camera.extra.size();
  s.number(count);
  s.template array<double>(camera.extra, count);
}

template <class Stream>
void pass_form(Stream& s, FormVectors& f, const Form& form) {
  s.agree(form.dim);
  for (const int value : variant_numbers(form.variant)) s.agree(value);
  s.agree(form.query_grad);
  Problem& p = f.problem;
  p.model.dim = form.dim, p.model.variant = form.variant, p.model.count = kSplats;
  p.query_grad = form.query_grad;
  const std::size_t rows = static_cast<std::size_t>(p.model.layout().count);
  constexpr std::size_t kPixels = static_cast<std::size_t>(kWidth) * kHeight;
  s.template array<float>(p.model.values, rows * kSplats);
  pass_camera(s, p.camera);
  p.target.assign(3 * kPixels, kTarget);
  for (float& x : p.background) s.number(x);
  s.template array<std::uint8_t>(p.undecided, kPixels);
  StageTruth& t = f.truth;
  s.template array<std::uint8_t>(t.visible, kSplats);
  s.template array<float>(t.records, kSplats * kSplatStride);
  s.template array<float>(t.image, 3 * kPixels);
  s.template array<float>(t.v_image, 3 * kPixels);
  s.template array<float>(t.v_records, kSplats * kGradStride);
  s.template array<float>(t.v_params, rows * kSplats);
  s.number(t.loss);
  s.template array<float>(f.penalties, 4 * kSplats);
  s.template array<float>(f.displacement, 3 * kSplats);
  s.template array<float>(f.displacement_size, 3 * kSplats);
  s.template array<float>(f.copies, rows * kSplats);
  s.template array<float>(f.copy_size, 3 * kSplats);
}

template <class Stream>
void pass_loss(Stream& s, LossVectors& loss) {
  s.number(loss.width);
  s.number(loss.height);
  const std::size_t size = 3 * static_cast<std::size_t>(loss.width) * static_cast<std::size_t>(loss.height);
  s.template array<float>(loss.image, size);
  s.template array<std::uint8_t>(loss.target, size);
  s.number(loss.lambda_dssim);
  for (LossValues* v : {&loss.values, &loss.clamped}) {
    s.number(v->l1);
    s.number(v->ssim);
    for (double& x : v->mse) s.number(x);
  }
  s.template array<float>(loss.v_image, size);
}

template <class Stream>
void pass_adam(Stream& s, AdamVectors& a) {
  for (auto* floats : {&a.parameter, &a.moment1, &a.moment2, &a.gradient})
    s.template array<float>(*floats, kAdamCases);
  for (auto* doubles : {&a.new_parameter, &a.new_moment1, &a.new_moment2, &a.step_at_rest, &a.moment1_at_rest,
                        &a.moment2_at_rest, &a.opacity_penalty, &a.scale_penalty})
    s.template array<double>(*doubles, kAdamCases);
}

template <class Stream>
void pass(Stream& s, Vectors& v) {
  s.agree(kMagic);
  s.agree(forms().size());
  v.forms.resize(forms().size());
  for (std::size_t i = 0; i < forms().size(); ++i) pass_form(s, v.forms[i], forms()[i]);
  pass_loss(s, v.loss);
  pass_adam(s, v.adam);
  s.number(v.metrics.lpips);
  s.number(v.metrics.ssim);
}

}  // namespace

// The packed format consists of the uncompressed length and a zlib stream, which contains a checksum.
std::vector<std::byte> pack(const Vectors& vectors) {
  PackStream stream;
  Vectors copy = vectors;
  pass(stream, copy);
  const std::uint64_t size = stream.bytes().size();
  uLongf length = compressBound(size);
  std::vector<std::byte> out(sizeof size + length);
  std::memcpy(out.data(), &size, sizeof size);
  const int result = compress2(reinterpret_cast<Bytef*>(out.data() + sizeof size), &length,
                               reinterpret_cast<const Bytef*>(stream.bytes().data()), size, 9);
  if (result != Z_OK)
    fail(ErrorKind::internal, "the reference data of the device check cannot be compressed: zlib returned {}",
         result);
  out.resize(sizeof size + length);
  return out;
}

Vectors unpack(std::span<const std::byte> bytes) {
  constexpr std::uint64_t kMost = 1 << 28;
  std::uint64_t size = 0;
  if (bytes.size() > sizeof size) std::memcpy(&size, bytes.data(), sizeof size);
  if (size == 0 || size > kMost)
    fail(ErrorKind::internal, "the reference data of the device check are damaged");
  std::vector<std::byte> raw(size);
  uLongf length = size;
  const auto stored = bytes.subspan(sizeof size);
  const int result = uncompress(reinterpret_cast<Bytef*>(raw.data()), &length,
                                reinterpret_cast<const Bytef*>(stored.data()), stored.size());
  if (result != Z_OK || length != size)
    fail(ErrorKind::internal, "the reference data of the device check are damaged");
  UnpackStream stream(raw);
  Vectors vectors;
  pass(stream, vectors);
  stream.end();
  return vectors;
}

}  // namespace ubs::check
