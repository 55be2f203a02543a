// SPDX-License-Identifier: Apache-2.0
// Tests the executable in unfavourable environments: with caches that cannot be written, with standard
// streams that are closed or full, with little memory, and with signals.
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <tuple>

#include "host/check/metric_inputs.hpp"
#include "host/pipeline/network.hpp"
#include "tests/support/run_ubs.hpp"
#include "tests/support/write_safetensors.hpp"

namespace ubs {
namespace {

using test::check_error;
using test::ended_by;
using test::get;
using test::program_of;
using test::put;
using test::Result;
using test::run_command;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// Returns a shell command that runs the program with the environment variables `variables`, and without the
// variables for cache folders that the test was started with.
std::string with_cache(const std::string& variables, const std::string& arguments) {
  return fmt::format("env -u POCL_CACHE_DIR -u UBS_KERNEL_CACHE -u XDG_CACHE_HOME TMPDIR=$PWD {} '{}' {}",
                     variables, program_of(arguments), arguments);
}

std::size_t lines(const std::string& text) {
  return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
}

bool works(const std::string& command) { return std::system((command + " >/dev/null 2>&1").c_str()) == 0; }

// Loading a library from the working folder would be unsafe: the folder may contain data of another user, and
// code in it would be run.
TEST_CASE("no library is searched for in the working folder") {
  const TempFolder folder;
  const Result result = run_command(folder, fmt::format("env LD_DEBUG=libs '{}' --version", UBS_EXECUTABLE));
  REQUIRE(result.code == 0);
  REQUIRE(result.err.find("trying file=/") != std::string::npos);
  const std::regex elsewhere("trying file=[^/].*");
  std::smatch found;
  CHECK_FALSE(std::regex_search(result.err, found, elsewhere));
  CHECK(found.str() == "");
  CHECK(result.err.find("imgcodecs") ==
        std::string::npos);  // a command without images does not load OpenCV's codecs
}

TEST_CASE("without the OpenCV module, commands that do not need it work; errors of others name the module") {
  const TempFolder folder;
  std::filesystem::copy(UBS_EXECUTABLE, folder / "ubs");
  ubs_ok(folder, "synth glossy --size 16 --views 2 --test-views 1 --supersampling 1 --out data");
  const Result read = run_command(folder, "./ubs metrics data/test/r_000.png data/test/r_000.png");
  INFO(read.err);
  CHECK(read.code == 0);
  std::string bmp(54, '\0');  // the header of an image of 16 x 16 pixels
  bmp[0] = 'B', bmp[1] = 'M', bmp[14] = 40, bmp[18] = bmp[22] = 16;
  put(folder / "a.bmp", bmp);
  const Result missing = run_command(folder, "./ubs metrics a.bmp a.bmp");
  INFO(missing.err);
  CHECK(missing.code == 3);
  CHECK(missing.err.find("ubs: error: libubs_opencv-") != std::string::npos);
}

TEST_CASE("if the kernel cache cannot be written, another folder is used, with a warning of one line") {
  for (const std::string variable : {"UBS_KERNEL_CACHE", "XDG_CACHE_HOME", "HOME", "POCL_CACHE_DIR"}) {
    const TempFolder folder;
    put(folder / "file", "");
    const Result result = run_command(folder, with_cache(variable + "=file", "devices"));
    INFO(variable << "\n" << result.err);
    CHECK(result.code == 0);
    CHECK(result.out.find("Portable Computing Language") != std::string::npos);
    CHECK(lines(result.err) == 1);
    CHECK(result.err.find((folder / "file").string()) != std::string::npos);
    const std::string own = fmt::format("ubs-{}", ::geteuid());
    CHECK(result.err.find(own) != std::string::npos);
    CHECK(std::filesystem::is_directory(folder / own / "pocl"));
  }
}

std::set<std::string> kept_kernels(const std::filesystem::path& folder) {
  std::set<std::string> libraries;
  for (const auto& file : std::filesystem::recursive_directory_iterator(folder))
    if (file.path().extension() == ".so") libraries.insert(file.path());
  return libraries;
}

// If ubs did not set a cache folder, PoCL would store compiled kernels in a folder such as /tmp/pocl, which
// another user may have created, and run code from there.
TEST_CASE("without a folder of the user, kernels are compiled in a folder that belongs to the process") {
  const TempFolder folder;
  put(folder / fmt::format("ubs-{}", ::geteuid()), "");  // simulates that another user created it first
  for (const std::string given : {"", "HOME= XDG_CACHE_HOME= POCL_CACHE_DIR=", "UBS_KERNEL_CACHE=off"}) {
    const Result result =
        run_command(folder, fmt::format("strace -f -qq -e trace=mkdir,openat -o calls env -u HOME {}",
                                        with_cache(given, "devices")));
    if (result.code == 127) {
      WARN("this test is skipped: strace is not installed");
      return;
    }
    INFO(given << "\n" << result.err);
    CHECK(result.code == 0);
    CHECK(result.out.find("Portable Computing Language") != std::string::npos);
    const std::string calls = get(folder / "calls");
    CHECK(calls.find("/ubs-temporary-") != std::string::npos);
    for (const char* guessable : {"/tmp/pocl", "/tmp/.pocl", "/var/cache/pocl", "/var/tmp/pocl", "kcache"})
      CHECK(calls.find(guessable) == std::string::npos);
  }
  for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
    CHECK(entry.path().filename().string().find("ubs-temporary-") == std::string::npos);
}

TEST_CASE("a damaged kernel cache is repaired, with one warning") {
  const TempFolder folder;
  const std::string train = with_cache(
      "UBS_KERNEL_CACHE=$PWD/cache",
      "train data --out run --overwrite --dim 3 --iterations 1 --init-points 10 --cap-max 10 --quiet");
  ubs_ok(folder, "synth glossy --out data --width 16 --height 16 --views 2 --test-views 1");
  REQUIRE(run_command(folder, train).code == 0);
  const std::string model = get(folder / "run/model.ply");
  for (const std::string damage : {"-name '*.so' -exec truncate -s 0", "-name '*.bc' -exec truncate -s 0",
                                   "-name '*.so' -exec truncate -s 9000"}) {
    REQUIRE(run_command(folder, "find cache " + damage + " {} \\;").code == 0);
    const Result result = run_command(folder, train);
    INFO(damage << "\n" << result.err);
    CHECK(result.code == 0);
    CHECK(lines(result.err) == 1);
    CHECK(result.err.find("cache/pocl were damaged") != std::string::npos);
    CHECK(get(folder / "run/model.ply") == model);
    const Result again = run_command(folder, train);
    CHECK(again.code == 0);
    CHECK(again.err.empty());
  }
}

TEST_CASE("if no folder can store kernels, the error names these folders, and not a missing driver") {
  const TempFolder folder;
  put(folder / "file", "");
  const Result result = run_command(folder, with_cache("HOME=file TMPDIR=/proc", "devices"));
  INFO(result.err);
  CHECK(result.code == 3);
  CHECK(lines(result.err) == 1);
  CHECK(result.err.find("file/.cache/ubs") != std::string::npos);
  CHECK(result.err.find("/proc/ubs-") != std::string::npos);
}

TEST_CASE("a full disk that contains the kernel cache is detected before the driver is used") {
  if (!works("unshare -rm true")) {
    WARN("this test is skipped: user namespaces are not available");
    return;
  }
  const TempFolder folder;
  std::filesystem::create_directories(folder / "full");
  const Result result =
      run_command(folder, fmt::format("unshare -rm sh -c \"mount -t tmpfs -o size=1m none full && {}\"",
                                      with_cache("UBS_KERNEL_CACHE=full/cache TMPDIR=.", "devices")));
  INFO(result.err);
  CHECK(result.code == 0);
  CHECK(result.err.find("No space left on device") != std::string::npos);
}

TEST_CASE("if the working folder has been removed, the error says so and is a data error") {
  const TempFolder folder;
  put(folder / "data/transforms_train.json", "{}");
  const Result result =
      run_command(folder, fmt::format("sh -c \"mkdir gone && cd gone && rmdir ../gone && '{}' train '{}'\"",
                                      UBS_EXECUTABLE, (folder / "data").string()));
  INFO(result.err);
  CHECK(result.code == 3);
  CHECK(lines(result.err) == 1);
  CHECK(result.err.find("cannot get current path: No such file or directory") != std::string::npos);
}

// Creates a tiny data set in data/.
void make_data(const TempFolder& folder) {
  ubs_ok(folder, "synth glossy --out data --width 16 --height 16 --views 2 --test-views 1");
}

// Returns the command of a very short training with this data set.
std::string train_command(int iterations, const std::string& more = "") {
  return fmt::format(
      "'{}' train --data data --out run --overwrite --dim 3 --iterations {} --init-points 10 --cap-max 10 {}",
      UBS_EXECUTABLE, iterations, more);
}

TEST_CASE("commands fail if they cannot write to stdout") {
  const TempFolder folder;
  make_data(folder);
  REQUIRE(run_command(folder, train_command(1, "--quiet")).code == 0);
  std::filesystem::rename(folder / "run", folder / "before");
  const std::string data = "--data data --dim 3 --iterations 1 --init-points 10 --cap-max 10";
  for (const std::string& arguments :
       {std::string("--help"), std::string("--version"), std::string("train --help"), std::string("devices"),
        std::string("devices --json"), std::string("info before/model.ply"), std::string("info data --json"),
        std::string("bench --list"), std::string("metrics before/renders before/renders"), "plan " + data,
        "plan --json " + data, std::string("eval --model before/model.ply --data data"),
        std::string("convert before/model.ply copy.ply --distill 0"),
        std::string("pack data --out copy.ubsd"), "train --out run " + data,
        "train --out run2 --json " + data}) {
    const Result result =
        run_command(folder, fmt::format("sh -c \"'{}' {} >/dev/full\"", program_of(arguments), arguments));
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == 3);
    CHECK(result.err.find(": error: cannot write to standard output: No space left on device\n") !=
          std::string::npos);
  }
  // The files that these commands write must exist nevertheless.
  for (const char* file : {"copy.ply", "copy.ubsd", "run/model.ply", "run2/metrics.json"})
    CHECK(std::filesystem::exists(folder / file));
  const Result errors =
      run_command(folder, fmt::format("sh -c \"'{}' info missing 2>/dev/full\"", UBS_EXECUTABLE));
  CHECK(errors.code == 3);
}

TEST_CASE("a closed pipe ends a printing command without a message, but does not end training") {
  const TempFolder folder;
  make_data(folder);
  // The pipe is closed before anything is written to it.
  const auto into_closed_pipe = [&](const std::string& command) {
    const Result result = run_command(
        folder, fmt::format("bash -c \"(sleep 0.2; {} 2>err.txt; echo \\$? >code.txt) | true\"", command));
    CHECK(result.code == 0);
    return std::stoi(get(folder / "code.txt"));
  };
  CHECK(into_closed_pipe(fmt::format("'{}' bench --list", UBS_LAB_EXECUTABLE)) == 3);
  CHECK(get(folder / "err.txt").empty());
  CHECK(into_closed_pipe(fmt::format("'{}' --help", UBS_EXECUTABLE)) == 3);
  CHECK(get(folder / "err.txt").empty());
  CHECK(into_closed_pipe(train_command(30)) == 0);
  CHECK(get(folder / "err.txt").find("ubs: ") == std::string::npos);
  CHECK(std::filesystem::exists(folder / "run/model.ply"));
  std::filesystem::remove_all(folder / "run");
  // With 2>&1, `ubs train` also writes its progress to the closed pipe.
  CHECK(into_closed_pipe("exec 2>&1; " + train_command(30, "--set eval_every=10")) == 0);
  CHECK(std::filesystem::exists(folder / "run/model.ply"));
}

TEST_CASE("if standard streams are closed, their output is not written into files of the training run") {
  const TempFolder folder;
  make_data(folder);
  for (const char* closed : {">&- 2>&-", ">&-", "2>&-", "<&- >&- 2>&-", "<&-"}) {
    const Result result = run_command(
        folder,
        fmt::format("sh -c \"{} {}\"", train_command(30, "--set eval_every=10 --set log_every=1"), closed));
    INFO(closed << "\n" << result.err);
    CHECK(result.code == 0);
    CHECK(std::filesystem::file_size(folder / "run/model.ply") > 500);
    const std::string log = get(folder / "run/log.csv");
    CHECK(lines(log) == 31);
    for (const char* word : {"it/s", "splats in", "device "}) CHECK(log.find(word) == std::string::npos);
  }
}

TEST_CASE("exceeding the maximum size of a file gives an error, and does not end the process by a signal") {
  const TempFolder folder;
  const Result result = run_command(
      folder, fmt::format("bash -c \"ulimit -f 4; exec '{}' synth glossy --out data\"", UBS_EXECUTABLE));
  INFO(result.err);
  CHECK(result.code == 3);
  CHECK(result.err.find("ubs: error: ") != std::string::npos);
}

Result train_with_little(const TempFolder& folder, int mebibytes, const std::string& environment) {
  return run_command(
      folder,
      fmt::format("bash -c \"ulimit -v {}; exec timeout -s KILL 600 {} {} 2>err.txt\"; cat err.txt >&2",
                  1024 * mebibytes, environment, train_command(2, "--quiet")));
}

TEST_CASE("too little address space gives a message with numbers, instead of a crash inside the driver") {
  const TempFolder folder;
  make_data(folder);
  // The program itself needs 200 MiB. The driver needs about 400 MiB more, and its compiler needs 90 MiB.
  for (const int mebibytes : {350, 490, 550}) {
    // Remove compiled kernels, so that the driver has to compile them, as for a new user.
    std::filesystem::remove_all(folder / "kernels");
    const Result result =
        train_with_little(folder, mebibytes, "env -u POCL_CACHE_DIR UBS_KERNEL_CACHE=kernels");
    INFO(mebibytes << " MiB\n" << result.err);
    CHECK(get(folder / "err.txt").find(fmt::format("{} MiB", mebibytes)) != std::string::npos);
    CHECK(get(folder / "err.txt").find("ubs: error: ") != std::string::npos);
    CHECK(get(folder / "err.txt").find("ulimit -v") != std::string::npos);
    CHECK(get(folder / "err.txt").find("0 of the 0 MiB") == std::string::npos);
    CHECK_FALSE(std::filesystem::exists(folder / "run/model.ply"));
  }
  // A driver that lacks address space lists no device. The reason is the limit, not a missing driver.
  for (int mebibytes = 330; mebibytes <= 430; mebibytes += 5) {
    const Result listed = run_command(
        folder, fmt::format("bash -c \"ulimit -v {}; exec '{}' devices\"", 1024 * mebibytes, UBS_EXECUTABLE));
    INFO(mebibytes << " MiB\n" << listed.err);
    CHECK((listed.code == 0 || listed.code == 6));
    CHECK(listed.err.find("no compute device found") == std::string::npos);
  }
  const Result enough = train_with_little(folder, 64000, "");
  INFO(enough.err);
  CHECK(std::filesystem::exists(folder / "run/model.ply"));
  // The output of plan must show the limit, and where it comes from.
  const std::string plan = fmt::format(
      "bash -c \"ulimit -v 64000000; exec '{}' plan --data data --dim 3 --iterations 1 "
      "--init-points 10 --cap-max 10\"",
      UBS_EXECUTABLE);
  CHECK(run_command(folder, plan).out.find(" 62500 MiB (address space, ulimit -v)") != std::string::npos);
}

// Runs the command with files of the test in place of those that describe the control group of a process.
// The test below writes files for a control group whose parent has a limit of 300 MiB. In this way, both
// versions of control groups are tested on every machine on which a user may mount files.
Result run_in_group(const TempFolder& folder, const std::string& command) {
  return run_command(
      folder, fmt::format("unshare -rm sh -c \"mount --bind cgroup /proc/\\$\\$/cgroup && mount --bind "
                          "groups /sys/fs/cgroup && exec {}\"",
                          command));
}

TEST_CASE("exceeding the memory limit of a control group gives exit code 6 and numbers before training") {
  const TempFolder folder;
  make_data(folder);
  const std::string limit = std::to_string(300 << 20);
  put(folder / "groups/job/memory.max", limit);
  put(folder / "groups/job/step/memory.max", "max\n");
  put(folder / "groups/memory/job/memory.limit_in_bytes", limit);
  put(folder / "cgroup", "");
  if (run_in_group(folder, "true").code != 0) {
    WARN("this test is skipped: files cannot be mounted; only memory_limit_test.cpp tests such limits");
    return;
  }
  const std::string train = fmt::format(
      "'{}' train data --out run --quiet --dim 3 --cap-max 1000000 --init-points 3000 --iterations ",
      UBS_EXECUTABLE);
  for (const char* group : {"0::/job/step\n", "3:cpu,memory:/job/step\n0::/\n"}) {
    put(folder / "cgroup", group);
    const Result result = run_in_group(folder, train + "3000");
    INFO(group << result.err);
    CHECK(result.code == 6);
    CHECK(lines(result.err) == 1);
    CHECK(result.err.find("limits: 300 MiB (control group)") != std::string::npos);
    CHECK_FALSE(std::filesystem::exists(folder / "run"));
  }
  put(folder / "cgroup", "0::/\n");  // without the limit, training starts
  const Result other = run_in_group(folder, train + "1");
  INFO(other.err);
  CHECK(other.code == 0);
}

// Returns a command that runs `command` with a limit for the processes and threads of the user. The limit
// does not apply to root, so root runs the command as another user.
std::string with_tasks(int most, const std::string& command) {
  return fmt::format("{}prlimit --nproc={} {}",
                     ::geteuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups " : "", most,
                     command);
}

TEST_CASE("if the system refuses another thread, ubs ends with exit code 6 before the driver aborts") {
  const TempFolder folder;
  make_data(folder);
  std::filesystem::permissions(folder.path(), std::filesystem::perms::all);
  if (!works(with_tasks(1000, fmt::format("'{}' --version", UBS_EXECUTABLE))) ||
      works(with_tasks(1, "sh -c '(true); true'"))) {
    WARN("this test is skipped: the number of threads cannot be limited");
    return;
  }
  // With a limit of two threads, ubs itself has enough threads, but PoCL does not. PoCL needs one thread for
  // each core, and one for its linker.
  for (const auto& [most, arguments] :
       {std::pair(1, "info data"), std::pair(1, "devices"), std::pair(2, "devices"),
        std::pair(2, "train data --out run --dim 3")}) {
    const Result result =
        run_command(folder, with_tasks(most, with_cache("UBS_KERNEL_CACHE=$PWD/cache", arguments)));
    INFO(most << " " << arguments << "\n" << result.err);
    CHECK(result.code == 6);
    CHECK(lines(result.err) == 1);
    CHECK(result.err.find("ubs: error: the system does not allow this process to create another thread") ==
          0);
  }
}

// PoCL stores one compiled version of a kernel for each group size with which the kernel is launched.
TEST_CASE("PoCL stores its kernels in the folder of ubs; training builds all of them before its first step") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 72 --views 3 --test-views 2 --supersampling 1");
  std::filesystem::create_directory(folder / "weights");
  test::put_safetensors(folder / "weights/lpips_alex.safetensors",
                        check::random_weights(lpips_network("alex"), 3).tensors);
  const auto train = [](int iterations) {
    return fmt::format(
        "train --data data --out run --overwrite --quiet --dim 3 --iterations {} "
        "--init-points 60 --cap-max 90 --eval-every 40",
        iterations);
  };
  const std::string lpips = " --lpips alex --lpips-weights weights";
  // The training is killed in its first step.
  const std::string ours =
      fmt::format("env -u POCL_CACHE_DIR UBS_KERNEL_CACHE='{}'", (folder / "kernels").string());
  CHECK(ended_by(folder, train(1'000'000) + lpips + " --log-every 1", SIGKILL, "run/config.yaml", ours) ==
        137);
  const std::set<std::string> first = kept_kernels(folder / "kernels/pocl");
  CHECK(first.size() > 20);
  const Result whole = run_command(folder, with_cache("UBS_KERNEL_CACHE=kernels", train(120) + lpips));
  INFO(whole.err);
  CHECK(whole.code == 0);
  CHECK(whole.err.empty());
  CHECK(kept_kernels(folder / "kernels/pocl") == first);
  CHECK(get(folder / "run/log.csv").find(",90") != std::string::npos);  // the model grew
  CHECK(get(folder / "run/metrics.json").find("lpips_alex") != std::string::npos);
  const Result cold = run_command(folder, with_cache("UBS_KERNEL_CACHE=off", train(1)));
  CHECK(cold.code == 0);
  CHECK_THAT(cold.err, !Catch::Contains("warning"));  // for example about files of the kernel compiler
  CHECK_FALSE(std::filesystem::exists(folder / fmt::format("ubs-{}/pocl", ::geteuid())));
}

TEST_CASE("SIGHUP ends training and saves a checkpoint and the model, but has no effect with nohup") {
  const TempFolder folder;
  make_data(folder);
  const std::string train =
      "train --data data --dim 3 --init-points 10 --cap-max 10 --quiet --log-every 10 "
      "--iterations ";
  CHECK(ended_by(folder, train + "1000000 --out run", SIGHUP, "run/log.csv") == 130);
  CHECK(std::filesystem::exists(folder / "run/checkpoint.ubs"));
  CHECK(std::filesystem::exists(folder / "run/model.ply"));
  CHECK(ended_by(folder, train + "300 --out run2", SIGHUP, "run2/log.csv", "nohup") == 0);
  CHECK_FALSE(std::filesystem::exists(folder / "run2/checkpoint.ubs"));
}

// A command that does not check for signals would end with the exit code 0 after minutes or hours.
TEST_CASE("every long command ends soon after a signal, and leaves no half-written file") {
  const TempFolder folder;
  ubs_ok(folder, "synth glossy --out data --size 64 --views 8 --test-views 8");
  ubs_ok(folder,
         "train --data data --out run --dim 6 --iterations 20 --init-points 2000 --cap-max 2000 --quiet");
  ubs_ok(folder,
         "train --data data --out big --dim 6 --iterations 1 --init-points 60000 --cap-max 60000 --quiet "
         "--save-renders 0");
  // Each command is interrupted when a file shows that it has started.
  for (const auto& [arguments, signal, begun] :
       {std::tuple{"bench", SIGINT, "out.txt"},
        {"tune", SIGINT, "out.txt"},
        {"compare --devices cpu,cpu --model run/model.ply --data data --repeat 100000 --out c", SIGTERM,
         "c/.ubs-lock"},
        {"accuracy --out a", SIGTERM, "err.txt"},
        {"render run/model.ply --out r --path orbit --path-frames 100000", SIGTERM, "r/frame_0000.png"},
        {"reduce --model big/model.ply --data data --out reduced.ply", SIGINT, "err.txt"}}) {
    const int code = ended_by(folder, arguments, signal, begun);
    INFO(arguments << " after signal " << signal << ": code " << code << "\n" << get(folder / "err.txt"));
    CHECK((code == 128 + signal || code == 130));
    for (const auto& left : std::filesystem::recursive_directory_iterator(folder.path()))
      CHECK(left.path().filename().string().find("tmp") == std::string::npos);
  }
}

TEST_CASE("subcommands only print with say() and remark()") {
  for (const auto& file : std::filesystem::recursive_directory_iterator(UBS_SOURCE_DIR "/tools")) {
    if (file.path().extension() != ".cpp") continue;
    INFO(file.path());
    const std::string text = get(file.path());
    for (const char* other : {"fmt::print(", "std::cout", "std::printf(", "std::puts("})
      CHECK(text.find(other) == std::string::npos);
  }
}

}  // namespace
}  // namespace ubs
