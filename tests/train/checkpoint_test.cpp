// SPDX-License-Identifier: Apache-2.0
// Tests checkpoints: a resumed run is bit-identical to an uninterrupted one, wherever it was interrupted.
// Modified files are rejected, and a failed write keeps the previous file.
#include "host/train/checkpoint.hpp"

#include <sys/resource.h>

#include <atomic>
#include <catch2/catch.hpp>
#include <csignal>

#include "host/base/file.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

using test::Data;
using test::kNone;
using test::message_of;
using test::same_bits;
using test::short_run;
using test::start;
using test::synthetic;
using test::TempFolder;

// Returns settings of a run of 60 iterations. Refinements at iterations 2, 4, ... 48 add splats, from 500 to
// 700.
TrainSettings small_run(int dim) {
  TrainSettings settings = short_run(dim, 60, 500);
  settings.cap_max = 700;
  settings.refine.step = 1000;
  settings.log_every = 7;
  return settings;
}

struct Rows {
  std::vector<std::pair<int, double>> losses;
};
// Trains until the given iteration and returns the logged losses with their iterations.
Rows run_to(Trainer& trainer, int iteration) {
  Rows rows;
  if (trainer.iteration() < iteration)
    trainer.run([&](const StepReport& report) {
      if (report.loss) rows.losses.emplace_back(report.iteration, *report.loss);
      return report.iteration < iteration;
    });
  return rows;
}

Checkpoint checkpoint_of(const TrainSettings& settings, TrainState state) {
  Checkpoint c;
  c.state = std::move(state);
  c.settings = settings;
  c.data = "/data";
  c.device = "device";
  c.build = "build";
  return c;
}

TEST_CASE("checkpoint: a run resumed at any point is bit-identical to an uninterrupted one", "[checkpoint]") {
  const Data data = synthetic("glossy", 32, 7);
  const TempFolder folder;
  for (const auto& device : devices_under_test()) {
    for (const int batch : {1, 3}) {
      TrainSettings settings = small_run(6);
      settings.batch = batch;
      if (batch > 1) settings.appearance = Appearance::affine;
      settings.background.learnt = batch > 1 ? Background::Learnt::colour : Background::Learnt::sky;
      if (batch > 1) settings.refine_cameras = RefineCameras::pose_and_intrinsics;
      Trainer whole(*device, settle(settings), data.train, kNone, start(settings));
      const Rows expected = run_to(whole, 60);
      const TrainState end = whole.state();
      REQUIRE(end.model.count == 700);
      // With one view per batch, the run is interrupted before the first iteration, before and after
      // refinements (at every second iteration), at and between iterations that are logged (7, 14, ...), and
      // in the middle of an epoch of 7 views. With three views per batch, it is only interrupted after
      // iteration 9.
      for (const int cut : batch == 1 ? std::vector<int>{0, 1, 3, 4, 5, 7, 20, 59} : std::vector<int>{9}) {
        INFO(device->info().name << ", batch " << batch << ", cut at " << cut);
        Trainer first(*device, settle(settings), data.train, kNone, start(settings));
        run_to(first, cut);
        Checkpoint kept = checkpoint_of(settings, first.state());
        kept.budget = {.seconds = 12.5,
                       .spent = 0.25,
                       .most_iterations = 900,
                       .first_iterations = 70,
                       .costs = {{2, 3.5, 1e-3, 0}, {1, 7, 2e-3, 80}}};
        write_checkpoint(folder / "checkpoint", kept);
        const Checkpoint read = read_checkpoint(folder / "checkpoint");
        CHECK(read.budget == kept.budget);
        Trainer second(*device, settle(read.settings), data.train, kNone, read.state.model);
        second.restore(read.state);
        CHECK(second.iteration() == cut);
        const Rows rows = run_to(second, 60);
        const TrainState got = second.state();
        CHECK(same_bits(got.model.values, end.model.values));
        CHECK(same_bits(got.moment1, end.moment1));
        CHECK(same_bits(got.moment2, end.moment2));
        CHECK(same_bits(got.appearance, end.appearance));
        CHECK(same_bits(got.sky, end.sky));
        CHECK(got.sky.size() == kSkyState);
        CHECK(got.appearance.size() == (batch > 1 ? 7 * kAppearanceState : 0));
        CHECK(got.cameras == end.cameras);
        CHECK(got.cameras.size() == (batch > 1 ? 7 * 17 : 0));
        CHECK(got.adam_steps == end.adam_steps);
        CHECK(got.seconds >= read.state.seconds);
        REQUIRE_FALSE(rows.losses.empty());
        const std::vector<std::pair<int, double>> tail(
            expected.losses.end() - static_cast<std::ptrdiff_t>(rows.losses.size()), expected.losses.end());
        CHECK(rows.losses == tail);
      }
    }
  }
}

TEST_CASE("checkpoint: states are saved at the set intervals, and a failed write keeps the previous file",
          "[checkpoint]") {
  const Data data = synthetic("glossy", 16, 3);
  const TempFolder folder;
  for (const auto& device : devices_under_test()) {
    const TrainSettings settings = small_run(3);
    Trainer trainer(*device, settle(settings), data.train, kNone, start(settings));
    std::vector<int> saved;
    trainer.on_state({20, 0, [&](const TrainState& state) { saved.push_back(state.iteration); }});
    run_to(trainer, 60);
    CHECK(saved == std::vector<int>{20, 40});  // not at the last iteration, at which the model is written
    saved.clear();
    Trainer timed(*device, settle(settings), data.train, kNone, start(settings));
    timed.on_state({0, 1e-9, [&](const TrainState& state) { saved.push_back(state.iteration); }});
    run_to(timed, 60);
    CHECK(saved.size() == 59);

    const std::filesystem::path path = folder / "checkpoint";
    Checkpoint c = checkpoint_of(settings, trainer.state());
    c.state.iteration = c.state.logged = 20;
    write_checkpoint(path, c);
    c.state.iteration = 40;
    rlimit limit{};
    getrlimit(RLIMIT_FSIZE, &limit);
    const auto handler = std::signal(SIGXFSZ, SIG_IGN);
    const rlimit small{10'000, limit.rlim_max};  // writing fails after some bytes, as on a full disk
    setrlimit(RLIMIT_FSIZE, &small);
    const std::string message = message_of([&] { write_checkpoint(path, c); });
    setrlimit(RLIMIT_FSIZE, &limit);
    std::signal(SIGXFSZ, handler);
    CHECK(message.find("disk full?") != std::string::npos);
    CHECK(read_checkpoint(path).state.iteration == 20);
    CHECK(test::file_count(folder.path()) == 1);
    c.state.moment1[3] = std::numeric_limits<float>::quiet_NaN();
    CHECK(message_of([&] { write_checkpoint(path, c); }, ErrorKind::numerical).find("not finite") !=
          std::string::npos);
    CHECK(read_checkpoint(path).state.iteration == 20);
  }
}

TEST_CASE("checkpoint: truncated files, damaged files and other versions are rejected", "[checkpoint]") {
  const TempFolder folder;
  TrainState state;
  state.model = start(short_run(3, 10, 50));
  state.moment1.assign(state.model.values.size(), 0.25f);
  state.moment2.assign(state.model.values.size(), 0.5f);
  state.loss_sums.assign(80, 1.0f);
  state.iteration = 4;
  state.adam_steps = 1ull << 40;
  state.seconds = 1.0 / 3;
  state.skipped_draws = {3, 1ull << 50};
  TrainSettings settings = short_run(3, 10, 50);
  settings.lr_rgb = 1.0 / 7;
  const std::filesystem::path path = folder / "checkpoint";
  write_checkpoint(path, checkpoint_of(settings, state));
  const Checkpoint back = read_checkpoint(path);
  CHECK(same_bits(back.state.model.values, state.model.values));
  CHECK(back.state.adam_steps == state.adam_steps);
  CHECK(back.state.seconds == state.seconds);
  CHECK(back.state.skipped_draws == state.skipped_draws);
  CHECK(back.settings.lr_rgb == settings.lr_rgb);

  const std::vector<std::byte> good = read_file(path);
  const auto refused = [&](std::vector<std::byte> bytes) {
    write_file_atomically(path, std::span<const std::byte>(bytes));
    return message_of([&] { read_checkpoint(path); });
  };
  for (const std::size_t size : {std::size_t{0}, std::size_t{7}, std::size_t{15}, std::size_t{40},
                                 good.size() / 2, good.size() - 4, good.size() - 1}) {
    INFO("truncated to " << size << " of " << good.size());
    CHECK(refused({good.begin(), good.begin() + static_cast<std::ptrdiff_t>(size)}).find("checkpoint") !=
          std::string::npos);
  }
  for (std::size_t at = 0; at < good.size(); at += good.size() / 97 + 1) {  // bytes in all parts of the file
    std::vector<std::byte> bytes = good;
    bytes[at] ^= std::byte{0x10};
    INFO("bit flipped in byte " << at);
    CHECK_FALSE(refused(bytes).empty());
  }
  std::vector<std::byte> longer = good;
  longer.push_back(std::byte{0});
  CHECK(refused(longer).find("bytes follow the CRC-32") != std::string::npos);
  std::vector<std::byte> version = good;
  version[8] = std::byte{9};
  CHECK(refused(version).find("version 9") != std::string::npos);
  std::vector<std::byte> empty_header = good;
  empty_header[12] = empty_header[13] = std::byte{0};
  CHECK_THAT(refused(empty_header), Catch::Contains("header"));
}

TEST_CASE("checkpoint: different settings and data, and invalid values of checkpoint_every, are detected",
          "[checkpoint]") {
  const TrainSettings stored;
  TrainSettings wanted = stored;
  wanted.save_renders = 3;
  wanted.on_nan = OnNan::drop;
  wanted.checkpoint_every = "50";
  check_same_settings(stored, wanted);
  wanted.lr_opacity = 0.04;
  CHECK(
      message_of([&] { check_same_settings(stored, wanted); }, ErrorKind::usage).find("lr_opacity = 0.04") !=
      std::string::npos);
  wanted = stored;
  wanted.iterations = 40000;
  CHECK(message_of([&] { check_same_settings(stored, wanted); }, ErrorKind::usage)
            .find("its schedule depends on") != std::string::npos);

  Data data = synthetic("glossy", 16, 3);
  const std::uint32_t print = fingerprint(data.train);
  Split other = data.train;
  other.views[1].camera.fx *= 1.0000001;
  CHECK(fingerprint(other) != print);
  other = data.train;
  other.views[0].image.rgb[7] ^= 1;
  CHECK(fingerprint(other) != print);
  std::swap(data.train.views[0], data.train.views[1]);
  CHECK(fingerprint(data.train) != print);
  for (const char* text : {"", "s", "-1", "1.5", "5m", "nans", "1e12s"}) {
    wanted = stored;
    wanted.checkpoint_every = text;
    CHECK_FALSE(message_of([&] { validate(wanted); }, ErrorKind::usage).empty());
  }
}

// An image source whose calls of load() are counted from 1. The calls whose numbers are in `failures` fail.
class MoodySource final : public ImageSource {
 public:
  MoodySource(Image8 image, std::vector<int> failures)
      : image_(std::move(image)), failures_(std::move(failures)) {}
  Image8 load() const override {
    const int call = ++calls_;
    for (const int failure : failures_)
      if (call == failure) fail(ErrorKind::data, "moody.png: cannot be decoded");
    return image_;
  }

 private:
  Image8 image_;
  std::vector<int> failures_;
  mutable std::atomic<int> calls_{0};
};

TEST_CASE(
    "checkpoint: an image that fails once is read again, and if it fails twice the state stays consistent",
    "[checkpoint]") {
  Data data = synthetic("glossy", 16, 4);
  for (const auto& device : devices_under_test()) {
    const TrainSettings settings = short_run(3, 12, 200);
    Trainer whole(*device, settle(settings), data.train, kNone, start(settings));
    run_to(whole, 12);
    for (const bool twice : {false, true}) {
      Split train = data.train;
      ViewOrder order(settings.seed, 4);
      View& last = train.views[order(3)];  // the view of the fourth iteration
      last.source =
          std::make_shared<MoodySource>(last.image, twice ? std::vector<int>{1, 2} : std::vector<int>{1});
      Trainer trainer(*device, settle(settings), train, kNone, start(settings));
      if (!twice) {
        run_to(trainer, 12);
        CHECK(same_bits(trainer.model().values, whole.model().values));
        continue;
      }
      CHECK(message_of([&] { run_to(trainer, 12); }).find("moody.png") != std::string::npos);
      CHECK(trainer.state_is_consistent());
      CHECK(trainer.iteration() == 3);
      Trainer second(*device, settle(settings), data.train, kNone, start(settings));
      second.restore(trainer.state());
      run_to(second, 12);
      CHECK(same_bits(second.model().values, whole.model().values));
    }
  }
}

}  // namespace
}  // namespace ubs
