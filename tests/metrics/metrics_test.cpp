// SPDX-License-Identifier: Apache-2.0
// Tests image metrics on every device. LPIPS of small random networks is compared with loops in double
// precision, LPIPS of the published networks with reference values from torch, and the SSIM of windows that
// are completely inside the image with a direct evaluation. Also tests the predicted memory of LPIPS, frame
// rates, and the measurement of stage times during training.
#include <catch2/catch.hpp>
#include <random>

#include "host/base/error.hpp"
#include "host/check/metric_inputs.hpp"
#include "host/dataset/image.hpp"
#include "host/device/registry.hpp"
#include "host/lab/oracle/lpips_reference.hpp"
#include "host/lab/oracle/oracle.hpp"
#include "host/pipeline/frame_rate.hpp"
#include "host/pipeline/image_metrics.hpp"
#include "host/train/timed_stages.hpp"
#include "tests/support/data.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/simulated_time.hpp"

namespace {

using namespace ubs;
using check::image_pair;
using check::upload;
using check::Uploaded;
using oracle::Features;
using oracle::features;

// Reports that only one byte of memory is available for matrices, so that LPIPS computes convolutions in the
// smallest possible parts. Counts these parts.
class SmallMatrices final : public MetricOps {
 public:
  explicit SmallMatrices(MetricOps& ops) : ops_(ops) {}
  void load_image(const LoadImage& a) override { ops_.load_image(a); }
  void im2col(const Im2col& a) override { ++matrices, ops_.im2col(a); }
  void matrix_product(const MatrixProduct& a) override { ops_.matrix_product(a); }
  void bias_relu(const BiasRelu& a) override { ops_.bias_relu(a); }
  void max_pool(const MaxPool& a) override { ops_.max_pool(a); }
  void lpips_distance(const LpipsDistance& a) override { ops_.lpips_distance(a); }
  void valid_ssim(const ValidSsim& a) override { ops_.valid_ssim(a); }
  std::size_t matrix_bytes() const override { return 1; }
  std::size_t product_bytes(const MatrixProduct& a) const override { return ops_.product_bytes(a); }

  int matrices = 0;

 private:
  MetricOps& ops_;
};

}  // namespace

TEST_CASE("matrix product: long sums with offsets and pitches are correct, and other values are not changed",
          "[metrics]") {
  for (const auto& device : devices_under_test()) {
    INFO(device->info().name);
    const auto ops = make_metric_ops(*device);
    const int rows = 37, columns = 303, inner = 2500;  // more than one block on CPUs in both directions
    MatrixProduct p{.rows = rows,
                    .columns = columns,
                    .inner = inner,
                    .b_offset = 16,
                    .b_pitch = 320,
                    .c_offset = 48,
                    .c_pitch = 336};
    std::mt19937 generator(5);
    std::uniform_real_distribution<float> value(-1, 1);
    std::vector<float> a(static_cast<std::size_t>(rows * inner)),
        b(16 + static_cast<std::size_t>(inner) * 320);
    for (float& x : a) x = value(generator);
    for (float& x : b) x = value(generator);
    const std::vector<float> untouched(48 + static_cast<std::size_t>(rows) * 336, -7.0f);
    Buffer<float> buffer_a(*device, "a", a.size()), buffer_b(*device, "b", b.size());
    Buffer<float> buffer_c(*device, "c", untouched.size());
    buffer_a.upload(a);
    buffer_b.upload(b);
    buffer_c.upload(untouched);
    p.a = buffer_a.view();
    p.b = buffer_b.view();
    p.c = buffer_c.view();
    ops->matrix_product(p);
    const std::vector<float> c = buffer_c.download();
    double worst = 0;
    for (std::size_t i = 0; i < c.size(); ++i) {
      const std::size_t row = (i - 48) / 336, column = (i - 48) % 336;
      if (i < 48 || column >= static_cast<std::size_t>(columns)) {
        REQUIRE(c[i] == -7.0f);
        continue;
      }
      double sum = 0;
      for (std::size_t k = 0; k < static_cast<std::size_t>(inner); ++k)
        sum += static_cast<double>(a[row * inner + k]) * b[16 + k * 320 + column];
      worst = std::max(worst, std::abs(sum - static_cast<double>(c[i])));
    }
    CAPTURE(worst);
    // The largest error observed is 1.2e-4. It occurs with the CUDA back end on the host, which adds the
    // products one by one.
    CHECK(worst < 2.3e-4);
  }
}

TEST_CASE("lpips: small random networks agree with double-precision loops", "[metrics]") {
  for (const auto& device : devices_under_test()) {
    INFO(device->info().name);
    const auto ops = make_metric_ops(*device);
    for (const Network& network : lpips_networks()) {
      INFO(network.name);
      const TensorFile weights = check::random_weights(network, 7);
      Lpips lpips(*device, *ops, network, weights);
      SmallMatrices small(*ops);
      Lpips in_pieces(*device, small, network, weights);
      // The second size is smaller and uses the same buffers.
      for (const PlanarSize size : {PlanarSize{71, 66}, PlanarSize{36, 47}}) {
        const auto pair = image_pair(size);
        const Uploaded up = upload(*device, pair, size);
        for (const bool centred : {true, false}) {
          const double expected = oracle::lpips_reference(
              network, weights, {features(pair[0], size), features(pair[1], size)}, centred);
          const auto range = centred ? LpipsRange::signed_one : LpipsRange::unit;
          const double distance = lpips.distance(up.a, up.b, range);
          CAPTURE(size.width, centred, distance - expected);
          REQUIRE(expected > 0.02);
          // The distances are at most 1.2. The largest errors observed are 2.9e-7 with PoCL, and 2.7e-7 with
          // the CUDA back end on the host.
          CHECK(distance == Approx(expected).margin(6e-7).epsilon(0));
          CHECK(lpips.distance(up.a, up.b, range) == distance);  // a repetition gives the same bits
          CHECK(in_pieces.distance(up.a, up.b, range) == Approx(distance).margin(6e-7).epsilon(0));
          // The distance of equal images is exactly 0 if the compiler does not fuse multiplications and
          // additions.
          CHECK(lpips.distance(up.a, up.a, range) < 1e-12);
        }
      }
      CHECK(small.matrices > 50);
    }
  }
}

TEST_CASE("lpips: the used memory is at most the predicted memory, and at least 95 % of it", "[metrics]") {
  for (const auto& device : devices_under_test()) {
    INFO(device->info().name);
    const auto ops = make_metric_ops(*device);
    for (const char* name : {"alex", "squeeze"}) {
      const PlanarSize size{150, 131};
      const Uploaded up = upload(*device, image_pair(size), size);
      device->reset_peak();
      const std::uint64_t before = device->allocated_bytes();
      const auto fresh = make_metric_ops(*device);
      Lpips lpips(*device, *fresh, lpips_network(name), check::random_weights(lpips_network(name), 3));
      lpips.distance(up.a, up.b, LpipsRange::signed_one);
      const std::uint64_t predicted = lpips.memory(size).total(), used = device->peak_bytes() - before;
      CAPTURE(name, predicted, used);
      CHECK(used <= predicted);
      CHECK(static_cast<double>(used) > 0.95 * static_cast<double>(predicted));
    }
  }
}

TEST_CASE("lpips: unsuitable images and weights are rejected", "[metrics]") {
  const auto device = devices_under_test()[0];
  const auto ops = make_metric_ops(*device);
  CHECK(smallest_side(lpips_network("alex")) == 31);
  CHECK(smallest_side(lpips_network("squeeze")) == 25);
  CHECK(smallest_side(lpips_network("vgg")) == 16);
  CHECK_THROWS_WITH(lpips_network("resnet"), Catch::Contains("alex, squeeze or vgg"));
  const Network& network = lpips_network("vgg");
  TensorFile weights = check::random_weights(network, 7);
  {
    Lpips lpips(*device, *ops, network, weights);
    CHECK_THROWS_WITH(lpips.check_size({15, 400}), Catch::Contains("at least 16 x 16"));
    CHECK_NOTHROW(lpips.check_size({16, 16}));
  }
  weights.tensors.at("features.5.weight").shape[1] += 1;
  CHECK_THROWS_WITH(Lpips(*device, *ops, network, weights), Catch::Contains("'features.5'"));
  weights.tensors.erase("features.5.weight");
  CHECK_THROWS_WITH(Lpips(*device, *ops, network, weights),
                    Catch::Contains("tensor 'features.5.weight' is missing"));
}

// The reference values were computed with torch 1.13 on a CPU, and are listed in the README of the data.
TEST_CASE("lpips: the published networks give the reference values", "[metrics]") {
  UBS_REQUIRE_DATA(folder, "lpips_weights");
  if (!UBS_WITH_OPENCV) {
    WARN("skipped: this build was configured without OpenCV, so it cannot read images");
    return;
  }
  struct Proof {
    const char *network, *image;
    double distance;
  };
  const Proof proofs[] = {{"alex", "ex_p0", 0.7218806},
                          {"alex", "ex_p1", 0.1375656},
                          {"squeeze", "ex_p0", 0.7110476},
                          {"squeeze", "ex_p1", 0.1479016}};
  for (const auto& device : devices_under_test()) {
    if (device->info().name == "CUDA on the host") continue;  // takes half a minute with one thread
    INFO(device->info().name);
    ImageMetrics metrics(*device, {{"alex", "squeeze"}, folder, {LpipsRange::signed_one}});
    for (const Proof& proof : proofs) {
      std::array<std::vector<std::uint8_t>, 2> pair;
      PlanarSize size;
      const std::string names[] = {"ex_ref", proof.image};
      for (std::size_t i = 0; i < 2; ++i) {
        const Image8 image = load_image(folder / "test_images" / (names[i] + ".png"));
        size = {image.width, image.height};
        for (std::size_t c = 0; c < 3; ++c)
          for (std::size_t p = 0; p < size.pixels(); ++p) pair[i].push_back(image.rgb[3 * p + c]);
      }
      const Uploaded up = upload(*device, pair, size);
      for (const NamedValue& value : metrics.lpips(up.a, up.b)) {
        if (value.name != lpips_name(proof.network, LpipsRange::signed_one)) continue;
        CAPTURE(proof.network, proof.image);
        // An error of 1e-4 would be acceptable. The largest error observed is 2.1e-7 (PoCL), which is two
        // units of the last digit of `distance`.
        CHECK(value.value == Approx(proof.distance).margin(4e-7).epsilon(0));
      }
    }
  }
}

TEST_CASE("ssim: the mean over windows inside the image agrees with a direct evaluation", "[metrics]") {
  for (const auto& device : devices_under_test()) {
    INFO(device->info().name);
    ImageMetrics metrics(*device, {});
    for (const PlanarSize size : {PlanarSize{37, 30}, PlanarSize{11, 11}, PlanarSize{64, 12}}) {
      const auto pair = image_pair(size);
      const double expected = oracle::valid_ssim(features(pair[0], size).values,
                                                 features(pair[1], size).values, 3, size.height, size.width);
      const Uploaded up = upload(*device, pair, size);
      const auto ssim = metrics.valid_ssim(up.a, up.b);
      REQUIRE(ssim.has_value());
      CAPTURE(size.width, *ssim - expected);
      // The largest error observed is 6.8e-8 (PoCL).
      CHECK(*ssim == Approx(expected).margin(1.4e-7).epsilon(0));
      CHECK(*metrics.valid_ssim(up.a, up.a) == Approx(1).margin(1e-7).epsilon(0));
    }
    const PlanarSize small{10, 40};
    const Uploaded up = upload(*device, image_pair(small), small);
    CHECK_FALSE(metrics.valid_ssim(up.a, up.b).has_value());
  }
}

namespace {

// Simulates stages in which a step of Adam takes 0.125 s, and all other operations take no time.
class SlowAdam final : public Stages {
 public:
  explicit SlowAdam(test::SimulatedTime& time) : time_(time) {}
  const KernelConfig& config() const override { return config_; }
  Outcome run(const Operation& operation) override {
    return run_case(
        operation, [&](const AdamStep&) { time_.advance(0.125); },
        [](const CountLists&) { return ListTotals{}; }, [](const Relocate&) { return 0u; },
        [](const auto&) {});
  }

 private:
  test::SimulatedTime& time_;
  KernelConfig config_;
};

}  // namespace

TEST_CASE("frame rate: a device without timers reports no device time", "[metrics]") {
  const FrameRate timed = frame_rate_of({10, 20, 30}, {5, 4, 3});
  CHECK(timed.wall_fps == 50);
  CHECK(timed.device_fps == 250.0);
  const FrameRate untimed = frame_rate_of({10, 20, 30}, {0, 0, 0});
  CHECK(untimed.wall_fps == 50);
  CHECK_FALSE(untimed.device_fps.has_value());
}

TEST_CASE("stage times: sampled calls represent all calls, and evaluations are not counted", "[metrics]") {
  const auto device = devices_under_test()[0];
  test::SimulatedTime time;
  TimedStages stages(*device, std::make_unique<SlowAdam>(time), time);
  stages.adam({});  // a call before the first iteration is not counted
  for (int iteration = 1; iteration <= 400; ++iteration) {
    const bool refines = iteration % 100 == 0;
    stages.begin_iteration(iteration, refines);
    if (refines) stages.relocate({});
    stages.adam({});
    stages.pause();
    stages.raster_forward({});
  }
  const std::vector<StageTime> times = stages.times();
  REQUIRE(times.size() == 2);
  CHECK(times[0].stage == "adam");
  CHECK(times[0].calls == 400);
  // Iterations 29, 82, ..., 347 and the 4 iterations with a refinement are sampled.
  CHECK(times[0].sampled == 7 + 4);
  CHECK(times[0].seconds == 400 * 0.125);
  CHECK(times[1].stage == "relocate");
  CHECK(times[1].sampled == 4);
  CHECK(times[1].seconds == 0);
}
