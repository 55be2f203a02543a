// SPDX-License-Identifier: Apache-2.0
// Tests that several ranks under mpirun give the same results as one process, bit for bit (docs/cluster.md).
#include <array>
#include <catch2/catch.hpp>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>

#include "host/check/metric_inputs.hpp"
#include "host/cluster/mpi.hpp"
#include "host/cluster/view_assignment.hpp"
#include "host/dataset/image.hpp"
#include "host/pipeline/network.hpp"
#include "host/run/same_run.hpp"
#include "host/settings/schedule.hpp"
#include "host/train/checkpoint.hpp"
#include "host/train/rank_plan.hpp"
#include "host/train/run_settings.hpp"
#include "tests/support/images.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/published.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/whole_sweep.hpp"
#include "tests/support/write_safetensors.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::get;
using test::Result;
using test::TempFolder;
using test::ubs_ok;

// Environment variables of every rank. The first two allow root to use mpirun, as in a container. Each rank
// gets two threads of the device, because there are more ranks than cores. Kernels depend on the number of
// threads, and those for two threads are already in the cache of the CI machine.
const std::string kAsRank =
    "OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 POCL_MAX_PTHREAD_COUNT=2";

Result ranks(const TempFolder& folder, int count, const std::string& arguments,
             const std::string& environment = "") {
  return test::run_command(
      folder, fmt::format("env {} {} timeout 600 {} {} -n {} '{}' {}", kAsRank, environment, UBS_MPIEXEC,
                          UBS_MPIEXEC_FLAGS, count, UBS_EXECUTABLE, arguments));
}

void ranks_ok(const TempFolder& folder, int count, const std::string& arguments) {
  const Result result = ranks(folder, count, arguments);
  INFO(count << " ranks: ubs " << arguments << "\n" << result.err);
  REQUIRE(result.code == 0);
}

// Returns the command of a training run that grows from 300 to 420 splats within the first refinements, and
// relocates splats that the opacity penalty makes transparent.
std::string training(int dim, int batch, const std::string& out, int iterations = 120) {
  return fmt::format(
      "train data --out {} --dim {} --batch {} --init-points 300 --cap-max 420 --iterations {} "
      "--log-every 20 --save-renders 0 --opacity-reg 0.05 --set lr_opacity=0.2 --quiet",
      out, dim, batch, iterations);
}

void synthesise(const TempFolder& folder) { test::put_scene(folder / "data", 32, 10, 3); }

json metrics(const TempFolder& folder, const std::string& out) {
  return json::parse(get(folder / (out + "/metrics.json")));
}

void check_same(const TempFolder& folder, const std::string& a, const std::string& b) {
  INFO(a << " and " << b);
  const std::string model = get(folder / (a + "/model.ply"));
  REQUIRE(model.size() > 10000);
  CHECK((model == get(folder / (b + "/model.ply"))));
  for (const char* part : {"views", "wide_images", "mean"}) {
    INFO(part);
    CHECK(metrics(folder, a)["test"][part] == metrics(folder, b)["test"][part]);
  }
}

TEST_CASE("deal: faster ranks render more views, and the views of a round are consecutive") {
  const ViewAssignment even(8, 3);
  CHECK(even.counts() == std::vector<std::uint64_t>{3, 3, 2});
  for (std::uint64_t view = 0; view < 8; ++view) CHECK(even.rank_of(view) == static_cast<int>(view % 3));
  REQUIRE(even.rounds().size() == 3);
  CHECK(even.rounds()[2] == std::vector<std::int64_t>{6, 7, kNoView});
  const ViewAssignment more_ranks(2, 5);
  CHECK(more_ranks.rounds() == std::vector<std::vector<std::int64_t>>{{0, 1, kNoView, kNoView, kNoView}});
  const std::array<double, 3> speeds{1, 5, 2};
  const ViewAssignment fast(8, 3, speeds);
  CHECK(fast.counts() == std::vector<std::uint64_t>{1, 5, 2});
  CHECK(fast.rounds()[0] == std::vector<std::int64_t>{0, 1, 2});
  CHECK(fast.rounds()[1] == std::vector<std::int64_t>{kNoView, 3, 4});
  CHECK(fast.rounds()[4] == std::vector<std::int64_t>{kNoView, 7, kNoView});
  CHECK(fast.rank_of(4) == 2);
  CHECK(fast.rank_of(5) == 1);
}

TEST_CASE("learning rates of Adam scale with the square root of the batch size, and the noise does not") {
  TrainSettings settings = settle(test::published()).settings();
  settings.batch = 4;
  const ParameterLayout layout(6);
  const Schedule as_given(settings, 100, 2);
  settings.lr_batch = BatchRates::sqrt;
  const Schedule scaled(settings, 100, 2);
  const std::vector<float> one = as_given.learning_rates(layout, 700),
                           two = scaled.learning_rates(layout, 700);
  for (std::size_t row = 0; row < one.size(); ++row) CHECK(two[row] == 2 * one[row]);
  CHECK(one[0] > 0);
  CHECK(scaled.noise(700) == as_given.noise(700));
}

TEST_CASE("plan of ranks: work and bytes are divided, and transfers during rendering take no extra time") {
  RankCosts costs;
  costs.whole = {2, 1e-5};
  costs.project = {0.5, 1e-6};
  costs.draw = {1, 1e-5};
  costs.gradient = {0.25, 2e-6};
  costs.update = {0.125, 3e-6};
  costs.drawn_share = 0.5;
  costs.intersections_per_drawn = 4;
  const MemoryQuestion memory{.width = 64, .height = 64};
  const auto of = [&](int ranks, int batch, const RankNetwork& network) {
    return predict_ranks(costs, 1e6, batch, ranks, network, memory);
  };
  CHECK(of(1, 4, {}).step_ms() == Approx(4 * 12));
  CHECK(of(1, 4, {}).sent_bytes == 0);
  const RankPrediction two = of(2, 4, {1, 0});
  CHECK(two.compute_ms == Approx(4 * (0.5 + 0.5 + 0.25 + 1) + 2 * (1 + 5) + 0.125 + 1.5));
  // Each rank has 5e5 splats, of which half are visible, and renders 2 views. A record and its gradient have
  // 64 bytes each. The rank sends the records of its splats for the 2 views of the other rank, and the
  // gradients of its own 2 views for the splats of the other rank.
  CHECK(two.sent_bytes == Approx(0.5 * 64 * 5e5 * (2 + 2)));
  // The transfer takes 64 ms at 1 GB/s. For 6 ms of this time, the rank also renders one view.
  CHECK(two.network_ms == Approx(64 - 6));
  CHECK(of(2, 4, {100, 0}).network_ms == Approx(0.64 / 2));
  // With 4 views, 4 of the 8 ranks render nothing, so the time is more than half of the time of 8 views.
  CHECK(of(8, 4, {}).compute_ms > of(8, 8, {}).compute_ms / 2 + 0.1);
  CHECK(of(64, 64, {10, 100}).network_ms > of(64, 64, {10, 1}).network_ms + 10);
  CHECK(of(64, 64, {}).device_bytes < of(1, 64, {}).device_bytes);
}

// Starts a job whose output folder is `many`, and kills its last rank after the first checkpoint.
void kill_one(const TempFolder& folder, int count, const std::string& arguments,
              const std::string& environment = "") {
  // The ranks are child processes of the launcher.
  test::put(folder / "kill.sh", fmt::format(R"(
export {} {}
{} {} -n {} '{}' {} & job=$!
for i in $(seq 30000); do [ -s many/checkpoint.ubs ] && break; sleep 0.02; done
kill -KILL $(ps -o pid= --ppid $job | tail -n 1)
wait $job)",
                                            kAsRank, environment, UBS_MPIEXEC, UBS_MPIEXEC_FLAGS, count,
                                            UBS_EXECUTABLE, arguments));
  const Result killed = test::run_command(folder, "timeout 600 bash kill.sh");
  INFO(killed.err);
  CHECK(killed.code != 0);
  CHECK(killed.code != 124);  // the job did not hang
}

TEST_CASE("ranks: a signal to one rank ends all ranks, with a checkpoint and the same exit code") {
  const TempFolder folder;
  synthesise(folder);
  test::put(folder / "end.sh", fmt::format(R"sh(
export {}
{} {} -n 2 '{}' {} & job=$!
for i in $(seq 30000); do [ "$(wc -l < many/log.csv 2>/dev/null || echo 0)" -ge 2 ] && break; sleep 0.02; done
kill -TERM $(ps -o pid= --ppid $job | tail -n 1)
wait $job)sh",
                                           kAsRank, UBS_MPIEXEC, UBS_MPIEXEC_FLAGS, UBS_EXECUTABLE,
                                           training(6, 4, "many", 100000)));
  const Result ended = test::run_command(folder, "timeout 600 bash end.sh");
  INFO(ended.err);
  CHECK(ended.code == 130);
  CHECK(fs::exists(folder / "many/checkpoint.ubs"));
  CHECK(metrics(folder, "many")["interrupted"] == true);
}

TEST_CASE("ranks: training gives the same bits for different numbers of ranks and of threads per rank") {
  const TempFolder folder;
  synthesise(folder);
  for (const int dim : {3, 6, 7})
    for (const int batch : {4, 8}) {
      if (!test::whole_sweep() && (dim == 6 || batch != (dim == 3 ? 8 : 4))) continue;
      const std::string one = fmt::format("one_{}_{}", dim, batch);
      ubs_ok(folder, training(dim, batch, one));
      CHECK(metrics(folder, one)["splats"] == 420);
      for (const int count : {2, 4}) {
        if (!test::whole_sweep() && count != (dim == 3 ? 4 : 2)) continue;
        const std::string many = fmt::format("r{}_{}_{}", count, dim, batch);
        ranks_ok(folder, count, training(dim, batch, many));
        check_same(folder, one, many);
        CHECK(metrics(folder, many)["ranks"] == count);
      }
    }
  // With one thread, the kernels are different.
  const Result alone = test::run_command(
      folder, fmt::format("env POCL_MAX_PTHREAD_COUNT=1 '{}' {}", UBS_EXECUTABLE, training(3, 8, "alone")));
  INFO(alone.err);
  REQUIRE(alone.code == 0);
  check_same(folder, "one_3_8", "alone");
}

TEST_CASE(
    "ranks: the bits are the same without growth, with few views and splats, a learnt sky or random "
    "backgrounds") {
  const TempFolder folder;
  synthesise(folder);
  for (const auto& file : std::filesystem::recursive_directory_iterator(folder.path() / "data"))
    if (file.path().extension() == ".png") {
      const Image8 opaque = load_image(file.path(), {0.4, 0.5, 0.7});
      std::filesystem::remove(file.path());
      save_png(file.path(), opaque);
    }
  const std::string more =
      " --init-points 100 --cap-max 100 --appearance affine --noise-lr 0 --background sky";
  const std::string base =
      "train data --dim 6 --batch 2 --iterations 120 --save-renders 2 --opacity-reg 0.05 --set "
      "lr_opacity=0.2 "
      "--quiet";
  ubs_ok(folder, base + more + " --out one");
  // Without refinements, the model is different. As there is no noise and no growth, this shows that splats
  // were relocated.
  ubs_ok(folder, base + more + " --set refine=500:25000:30000 --out unrefined");
  CHECK_FALSE((get(folder / "one/model.ply") == get(folder / "unrefined/model.ply")));
  ranks_ok(folder, 3, base + more + " --out three");  // a step has only 2 views and 2 blocks of splats
  check_same(folder, "one", "three");
  for (const char* view : {"r_000", "r_001"})
    CHECK((get(folder / fmt::format("one/renders/{}.png", view)) ==
           get(folder / fmt::format("three/renders/{}.png", view))));
  const std::string random = " --init-points 100 --cap-max 120 --random-background on";
  ubs_ok(folder, base + random + " --out random");
  ranks_ok(folder, 2, base + random + " --out random_of_two");
  check_same(folder, "random", "random_of_two");
}

TEST_CASE("ranks: the quality of wide images is measured in their own lens model") {
  const TempFolder folder;
  test::put_panoramas(folder / "data", 4);
  // The quality is also measured after 20 iterations, so that training continues after other cameras have
  // been rendered.
  const std::string train =
      "train data --dim 6 --batch 4 --init-points 300 --cap-max 300 --iterations 40 --test-every 2 "
      "--eval-every 20 --appearance gain --save-renders 0 --quiet --out ";
  ubs_ok(folder, train + "one");
  CHECK(metrics(folder, "one")["test"]["wide_images"].size() == 2);
  ranks_ok(folder, 2, train + "two");
  check_same(folder, "one", "two");
}

// The test below runs this one on every rank.
TEST_CASE("messages between ranks", "[.rank]") {
  const std::unique_ptr<Communicator> ranks = join_job({.message = 1000});
  REQUIRE(ranks);
  CHECK(launched_ranks() == 1);  // join_job() hides the job, so that processes that a rank starts run alone
  const auto size = static_cast<std::size_t>(ranks->size()), rank = static_cast<std::size_t>(ranks->rank());
  // Each rank sends data to each rank. The sizes differ in each direction, from 0 bytes to many times the
  // maximum size of a message, which is 1000 bytes here.
  const auto count = [](std::size_t from, std::size_t to) { return from * to * 2500 + to; };
  std::vector<std::vector<std::uint32_t>> pieces;
  for (std::size_t to = 0; to < size; ++to)
    for (auto& piece = pieces.emplace_back(); piece.size() < count(rank, to);)
      piece.push_back(static_cast<std::uint32_t>(1000000 * rank + 100 * piece.size() + to));
  const std::vector<Bytes> come = exchange_values(*ranks, pieces);
  REQUIRE(come.size() == size);
  for (std::size_t from = 0; from < size; ++from) {
    const auto values = as_values<std::uint32_t>(come[from]);
    REQUIRE(values.size() == count(from, rank));
    for (std::size_t i = 0; i < values.size(); ++i) REQUIRE(values[i] == 1000000 * from + 100 * i + rank);
  }
  std::uint64_t sum = std::uint64_t{1} << 63 | rank;
  ranks->sum(std::span(&sum, 1));
  CHECK(sum == (std::uint64_t{1} << 63) * (size % 2) + size * (size - 1) / 2);
  CHECK(ranks->of_first(rank + 7) == 7);
  std::vector<float> floats(size);
  floats[rank] = -1.0f / static_cast<float>(rank + 3);
  ranks->merge(floats);
  for (std::size_t r = 0; r < size; ++r) CHECK(floats[r] == -1.0f / static_cast<float>(r + 3));
  CHECK(ranks->all_texts(std::string(rank, 'x')).back() == std::string(size - 1, 'x'));
  // Starts two transfers, computes a sum while they are in progress, and then waits for the second transfer
  // before the first.
  const std::vector<std::vector<std::uint32_t>> small(size, {static_cast<std::uint32_t>(rank)});
  Pieces large_bytes, small_bytes;
  for (std::size_t to = 0; to < size; ++to) {
    large_bytes.push_back(std::as_bytes(std::span(pieces[to])));
    small_bytes.push_back(std::as_bytes(std::span(small[to])));
  }
  const auto first = ranks->start(large_bytes), second = ranks->start(small_bytes);
  std::uint64_t one = 1;
  ranks->sum(std::span(&one, 1));
  CHECK(one == size);
  const std::vector<Bytes> small_come = second->finish(), large_come = first->finish();
  for (std::size_t from = 0; from < size; ++from) {
    CHECK(as_values<std::uint32_t>(small_come[from])[0] == from);
    CHECK((large_come[from] == come[from]));
  }
  // join_run() rejects ranks with another build or other data.
  const auto refusal = [&](const auto& change) {
    Checkpoint run;
    if (rank == 1) change(run);
    return test::message_of([&] { join_run(*ranks, run); }, ErrorKind::usage);
  };
  CHECK_THAT(refusal([](Checkpoint& run) { run.build = "x"; }), Contains("rank 1 has another build of ubs"));
  CHECK_THAT(refusal([](Checkpoint& run) { run.data_print = 3; }), Contains("rank 1 has other data"));
  Checkpoint run;
  run.device = rank == 1 ? "other" : "one";
  CHECK(join_run(*ranks, run) == 2);
  CHECK(run.device == "one + other");
}

TEST_CASE("ranks: messages of any size arrive, and long messages are sent in parts") {
  const TempFolder folder;
  const std::string self = fs::read_symlink("/proc/self/exe").string();
  const Result result = test::run_command(
      folder,
      fmt::format("env OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 timeout 600 {} {} -n 3 "
                  "'{}' '[.rank]'",
                  UBS_MPIEXEC, UBS_MPIEXEC_FLAGS, self));
  INFO(result.out << result.err);
  CHECK(result.code == 0);
  CHECK_THAT(result.out, Contains("assertions in 1 test case"));
}

TEST_CASE("ranks: if the disk of one rank is full, the checkpoint is lost but the run continues") {
  const TempFolder folder;
  synthesise(folder);
  const std::string run = training(6, 4, "many", 400) + " --checkpoint-every 20";
  ubs_ok(folder, training(6, 4, "one", 400));
  test::put(
      folder / "full.sh",
      fmt::format("trap '' XFSZ\n"
                  "[ \"$OMPI_COMM_WORLD_RANK$PMI_RANK\" = 1 ] && (while ! [ -s many/checkpoint.ubs ]; do "
                  "sleep 0.02; done; prlimit --pid $$ --fsize=60000) &\n"
                  "exec '{}' {}",
                  UBS_EXECUTABLE, run));
  const Result result = test::run_command(folder, fmt::format("env {} timeout 600 {} {} -n 2 bash full.sh",
                                                              kAsRank, UBS_MPIEXEC, UBS_MPIEXEC_FLAGS));
  INFO(result.err);
  REQUIRE(result.code == 0);
  CHECK_THAT(result.err, Contains("could not write the checkpoint at iteration"));
  CHECK_THAT(result.err, Contains(" remains"));
  CHECK_THAT(result.err, Contains("rank 1: "));
  CHECK_THAT(result.err, Contains("disk full?"));
  check_same(folder, "one", "many");
  for (const auto& entry : fs::directory_iterator(folder / "many"))
    CHECK_FALSE(entry.path().filename().string().starts_with(".ubs-tmp-"));
}

TEST_CASE("ranks: if no splats are visible, nothing is sent") {
  const TempFolder folder;
  synthesise(folder);
  const std::string base = training(6, 4, "one", 20) + " --set near_plane=1000";
  ubs_ok(folder, base);
  ranks_ok(folder, 3, training(6, 4, "many", 20) + " --set near_plane=1000");
  check_same(folder, "one", "many");
  CHECK(metrics(folder, "many")["bytes_sent_by_first_rank"] == 0);
}

TEST_CASE("ranks: training gives the same bits if one rank has no visible splats") {
  const TempFolder folder;
  synthesise(folder);
  std::string points =
      "ply\nformat ascii 1.0\nelement vertex 300\nproperty float x\nproperty float y\n"
      "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
      "end_header\n";
  for (int i = 0; i < 300; ++i)  // the points of the second half are beyond the far plane
    points += fmt::format("{} {} {} {} 120 90\n", (i < 150 ? 0.0 : 2e3) + 0.1 * (i % 7), 0.1 * (i % 5) - 0.2,
                          0.1 * (i % 3) - 0.1, i % 256);
  test::put(folder / "data/points3d.ply", points);
  const std::string more = " --far-plane 100 --set refine=500:25000:30000";
  ubs_ok(folder, training(6, 4, "one", 20) + more);
  ranks_ok(folder, 2, training(6, 4, "two", 20) + more);
  check_same(folder, "one", "two");
  // In each of the 20 steps, the first rank sends the records of its 150 splats, of 64 bytes each, for the 2
  // views that the other rank renders. It sends no gradients, because the splats of the other rank are not
  // visible.
  const double sent = metrics(folder, "two")["bytes_sent_by_first_rank"];
  CHECK(sent > 0);
  CHECK(sent < 1.1 * 64 * 150 * 2 * 20);  // including the headers
}

TEST_CASE("ranks: two kinds of devices share views by speed, and results are reproducible") {
  const TempFolder folder;
  synthesise(folder);
  const auto mixed = [&](const std::string& arguments) {
    const Result result =
        ranks(folder, 2, arguments + " --device basic,pthread", "POCL_DEVICES='basic pthread'");
    INFO(result.err);
    REQUIRE(result.code == 0);
    CHECK_THAT(result.err, Contains("2 kinds of devices"));
  };
  mixed(training(3, 6, "a"));
  const json first = metrics(folder, "a");
  const auto views = first["views_by_rank"].get<std::vector<int>>();
  REQUIRE(views.size() == 2);
  CHECK(views[0] + views[1] == 6);
  REQUIRE(first["picture_differences_by_rank"].size() == 2);
  CHECK(first["picture_differences_by_rank"][0] == 0.0);
  CHECK(first["picture_differences_by_rank"][1].get<double>() < 1e-3);
  mixed(training(3, 6, "b"));
  check_same(folder, "a", "b");
  // The checkpoint stores the number of views of each rank, and the resumed run keeps these numbers.
  const std::string two = " --device basic,pthread", kinds = "POCL_DEVICES='basic pthread'";
  kill_one(folder, 2, training(3, 6, "many", 600) + " --checkpoint-every 40" + two, kinds);
  const auto before = read_checkpoint(folder / "many/checkpoint.ubs").views_by_rank;
  CHECK(ranks(folder, 2, "train --resume many --quiet" + two, kinds).code == 0);
  CHECK(metrics(folder, "many")["views_by_rank"] == before);
}

TEST_CASE("ranks: step times are predicted") {
  const TempFolder folder;
  synthesise(folder);
  const json plan = json::parse(
      ubs_ok(folder, "plan data --dim 6 --batch 4 --ranks 1,2,64 --splats 1K,1G --link 2 --latency 3 --json")
          .out);
  REQUIRE(plan["predictions"].size() == 6);
  for (const json& row : plan["predictions"]) CHECK(row["step_ms"].get<double>() > 0);
  CHECK(plan["predictions"][5]["splats"] == 1e9);
  CHECK(plan["predictions"][4]["sent_bytes"].get<double>() >
        1e5 * plan["predictions"][1]["sent_bytes"].get<double>());
  CHECK(plan["costs"]["drawn_share"].get<double>() > 0.1);
  test::put(folder / "costs.json", plan["costs"].dump());
  const json again = json::parse(
      ubs_ok(
          folder,
          "plan data --dim 6 --batch 4 --ranks 64 --splats 1G --link 2 --latency 3 --costs costs.json --json")
          .out);
  CHECK(again["predictions"][0]["step_ms"].get<double>() ==
        Approx(plan["predictions"][5]["step_ms"].get<double>()));
  json negative = plan["costs"];
  negative["draw"]["fixed_ms"] = -1;
  test::put(folder / "costs.json", negative.dump());
  test::check_error(folder, "plan data --dim 6 --ranks 64 --splats 1G --costs costs.json", 3,
                    "costs.json: 'fixed_ms' is -1; it must be at least 0");
}

TEST_CASE("ranks: images, frames and measurements are the same as with one process") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, training(6, 4, "run"));
  const auto both = [&](const std::string& one, const std::string& many) {
    ubs_ok(folder, one);
    ranks_ok(folder, 2, many);
  };
  const std::string render =
      "render run/model.ply --data data --split train --channels rgb,alpha,depth --format npy";
  both(render + " --out a", render + " --out b");
  for (const char* file : {"r_000.npy", "r_003_alpha.npy", "r_004_depth.npy", "r_009.npy"})
    CHECK((get(folder / fmt::format("a/{}", file)) == get(folder / fmt::format("b/{}", file))));
  CHECK(get(folder / "a/r_009.npy").size() > 32 * 32 * 12);
  // Frames are compared, because encoders of videos are not reproducible.
  const std::string path = "render run/model.ply --path orbit --path-frames 7 --size 64x48 ";
  both(path + "--format npy --out c", path + "--format npy --out d");
  std::size_t frames = 0;
  for (const auto& entry : fs::directory_iterator(folder / "c")) {
    if (entry.path().extension() != ".npy") continue;
    CHECK((get(entry.path()) == get(folder / "d" / entry.path().filename())));
    ++frames;
  }
  CHECK(frames == 7);
  both(path + "--video a.mp4", path + "--video b.mp4");
  CHECK(fs::file_size(folder / "b.mp4") > fs::file_size(folder / "a.mp4") / 2);
  const std::string eval = "eval run/model.ply --data data --appearance gain --out ";
  both(eval + "a.json", eval + "b.json");
  const json a = json::parse(get(folder / "a.json")), b = json::parse(get(folder / "b.json"));
  CHECK(a["views"].size() == 3);
  CHECK(a["views"] == b["views"]);
  CHECK(a["mean"] == b["mean"]);
  // With such large weights, the sums in the network are infinite.
  TensorFile weights = check::random_weights(lpips_network("alex"), 3);
  std::ranges::fill(weights.tensors["features.0.weight"].values, 3e38f);
  fs::create_directory(folder / "w");
  test::put_safetensors(folder / "w/lpips_alex.safetensors", weights.tensors);
  const std::string lpips = "eval run/model.ply --data data --lpips alex --lpips-weights w";
  const Result one = test::run_ubs(folder, lpips), two = ranks(folder, 2, lpips);
  for (const Result& result : {one, two}) {
    INFO(result.err);
    CHECK(result.code == 7);
    CHECK(result.err.find("LPIPS with 'alex' is not finite") != std::string::npos);
    CHECK(result.err.find("internal") == std::string::npos);
  }
}

TEST_CASE("ranks: a killed rank ends the job, which can be resumed with another number of ranks") {
  const TempFolder folder;
  synthesise(folder);
  const std::string more = " --checkpoint-every 40";
  ubs_ok(folder, training(6, 4, "one", 600) + more);
  kill_one(folder, 3, training(6, 4, "many", 600) + more);
  REQUIRE_FALSE(get(folder / "many/checkpoint.ubs").empty());
  ranks_ok(folder, 2, "train --resume many --quiet");
  check_same(folder, "one", "many");
  CHECK(metrics(folder, "many")["resumed_from"] >= 40);
}

// The test does not wait for the end of the run.
TEST_CASE("ranks: without --iterations and --budget, a run has 16 000 iterations, and no time budget") {
  const TempFolder folder;
  synthesise(folder);
  test::put(
      folder / "stop.sh",
      fmt::format("{} {} -n 2 '{}' train data --out run --dim 3 --init-points 50 --cap-max 60 "
                  ">out.txt 2>&1 & pid=$!\n"
                  "i=0; until grep -q '^begins' out.txt || [ $i -ge 6000 ]; do sleep 0.1; i=$((i+1)); done\n"
                  "kill -TERM $pid; wait $pid\n",
                  UBS_MPIEXEC, UBS_MPIEXEC_FLAGS, UBS_EXECUTABLE));
  test::run_command(folder, fmt::format("env {} sh stop.sh", kAsRank));
  CHECK_THAT(get(folder / "out.txt"), Contains("schedule 16000 iterations, at most 60 splats"));
  CHECK_THAT(get(folder / "run/config.yaml"), Contains("\niterations: 16000 "));
}

TEST_CASE("ranks: errors are printed once, with the number of the rank") {
  const TempFolder folder;
  synthesise(folder);
  const auto fails = [&](const std::string& arguments, int code, const std::string& part,
                         const std::string& environment = "") {
    const Result result = ranks(folder, 2, arguments, environment);
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == code);
    CHECK_THAT(result.err, Contains(part));
    const std::string error = "ubs: error: ";
    CHECK(result.err.find(error, result.err.find(error) + 1) == std::string::npos);
  };
  fails("train nowhere --out o", 3, "nowhere");
  fails("train data --out o --budget 1m", 2, "--budget");
  fails("info o", 2, "'ubs info' only runs in a single process: start it without mpirun");
  // Simulates a launcher that passes different options to the ranks.
  test::put(folder / "other.sh", fmt::format("exec '{}' {} --seed 4$OMPI_COMM_WORLD_RANK$PMI_RANK",
                                             UBS_EXECUTABLE, training(6, 4, "o")));
  const Result other = test::run_command(
      folder, fmt::format("env {} {} {} -n 2 bash other.sh", kAsRank, UBS_MPIEXEC, UBS_MPIEXEC_FLAGS));
  INFO(other.err);
  CHECK(other.code == 2);
  CHECK_THAT(other.err, Contains("rank 1 has other settings"));
  test::put_scene(folder / "data2", 32, 9, 3);
  test::put(folder / "data.sh", fmt::format("[ \"$OMPI_COMM_WORLD_RANK$PMI_RANK\" = 1 ] && other=2\n"
                                            "exec '{}' train data$other {}",
                                            UBS_EXECUTABLE, training(6, 4, "o").substr(10)));
  const Result data = test::run_command(
      folder, fmt::format("env {} {} {} -n 2 bash data.sh", kAsRank, UBS_MPIEXEC, UBS_MPIEXEC_FLAGS));
  INFO(data.err);
  CHECK(data.code == 2);
  CHECK_THAT(data.err, Contains("rank 1 has other data"));
  // If a rank hangs, the other one only waits for a minute, and not for ever. With a shorter limit, the job
  // could end before the rank is stopped, because its first step may be slow on a busy machine.
  test::put(
      folder / "stuck.sh",
      fmt::format(
          "[ \"$OMPI_COMM_WORLD_RANK$PMI_RANK\" = 1 ] && (while ! [ -s stuck/log.csv ]; do sleep 0.05; done; "
          "kill -STOP $$) &\n"
          "exec '{}' {}",
          UBS_EXECUTABLE, training(6, 4, "stuck", 100'000)));
  const Result stuck = test::run_command(
      folder, fmt::format("env {} UBS_RANK_PATIENCE=60 timeout -k 1 600 {} {} -n 2 bash stuck.sh", kAsRank,
                          UBS_MPIEXEC, UBS_MPIEXEC_FLAGS));
  INFO(stuck.err);
  CHECK(stuck.code == 4);
  CHECK_FALSE(get(folder / "stuck/log.csv").empty());  // the rank was stopped, and not just slow to start
  CHECK_THAT(stuck.err, Contains("no answer from the other ranks"));
}

}  // namespace
}  // namespace ubs
