// SPDX-License-Identifier: Apache-2.0
// Tests which files commands replace and remove: only files with known names, and only with --overwrite.
#include <map>
#include <nlohmann/json.hpp>

#include "tests/support/run_ubs.hpp"
#include "tests/support/whole_sweep.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using test::check_error;
using test::get;
using test::put;
using test::Result;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

constexpr const char* kShort = "--init-points 100 --cap-max 120 --log-every 10 --quiet";

void synthesise(const TempFolder& folder) {
  ubs_ok(folder, "synth glossy --out data --size 32 --views 4 --test-views 2 --supersampling 1");
}

std::string train(const std::string& out, const std::string& more = "", int iterations = 20) {
  return fmt::format("train --data data --out {} {} --iterations {} {}", out, kShort, iterations, more);
}

// Returns the contents of all files in the folder by name, except stdout.txt and stderr.txt.
std::map<std::string, std::string> contents(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder))
    if (entry.is_regular_file() && !entry.path().filename().string().starts_with("std"))
      files[entry.path().lexically_relative(folder).string()] = get(entry.path());
  return files;
}

// Checks that the command fails with code 2 and changes no file.
void check_refused(const TempFolder& folder, const std::string& arguments, const std::string& part) {
  const auto before = contents(folder.path());
  check_error(folder, arguments, 2, part);
  CHECK(contents(folder.path()) == before);
}

TEST_CASE("outputs: training does not change photographs, wherever they are") {
  const TempFolder folder;
  synthesise(folder);
  fs::create_directory_symlink("data", folder / "alias");
  check_refused(folder, train("data"), "is the data");
  check_refused(folder, train("data", "--overwrite"), "is the data");
  check_refused(folder, train("alias"), "is the data");
  check_refused(folder, train("data/train", "--overwrite"),
                "data/train: this folder contains images or cameras");
  check_refused(folder, train("alias/val"), "alias/val: this folder contains images or cameras");
  check_refused(folder, train("."), "holds the data");
  fs::create_directory(folder / "set");
  ubs_ok(folder, "pack data --out set/F.ubsd");
  check_refused(folder, fmt::format("train --data set/F.ubsd --out set {}", kShort), "holds the data");

  const std::vector<std::string> mine{"renders/mine.png", "cameras/mine.txt", "notes.txt"};
  for (const std::string& name : mine) put(folder / "run" / name, "precious");
  ubs_ok(folder, train("run"));
  ubs_ok(folder, train("run", "--overwrite"));
  for (const std::string& name : mine) CHECK(get(folder / "run" / name) == "precious");
  CHECK(fs::exists(folder / "run/renders/r_000.png"));
}

TEST_CASE("outputs: a run replaces files that have the names of its results only with --overwrite") {
  const TempFolder folder;
  synthesise(folder);
  const TempFolder other;
  fs::create_directory_symlink(folder / "data", other / "data");
  for (const char* name : {"model.ply", "metrics.json", "log.csv", "config.yaml", "checkpoint.ubs",
                           "continue.ubs", "renders/r_001.png", "cameras/images.txt"}) {
    INFO(name);
    fs::remove_all(other / "run");
    put(other / "run" / name, "precious");
    check_refused(other, train("run"), "--overwrite");
  }
  put(other / "run/renders/mine.png", "precious");
  put(other / "run/renders/r_001.png", "precious");
  put(other / "run/metrics.json", "precious");
  ubs_ok(other, train("run", "--overwrite"));
  CHECK(get(other / "run/renders/mine.png") == "precious");
  CHECK(get(other / "run/renders/r_001.png") != "precious");
  CHECK(get(other / "run/metrics.json") != "precious");
  CHECK_FALSE(fs::exists(other / "run/cameras"));  // the empty folder was removed
  fs::remove(other / "run/log.csv");
  fs::create_symlink("renders/mine.png", other / "run/log.csv");
  const auto before = contents(other.path());
  check_error(other, train("run", "--overwrite"), 3, "log.csv: this is a symbolic link");
  CHECK(contents(other.path()) == before);
  fs::create_directory(other / "linked");
  fs::create_directory_symlink("../run/renders", other / "linked/renders");
  check_error(other, train("linked", "--overwrite"), 3, "linked/renders: this is a symbolic link");
  put(other / "blocked/renders", "precious");
  check_error(other, train("blocked", "--overwrite"), 3, "blocked/renders: this is not a folder");
  CHECK_FALSE(fs::exists(other / "blocked/config.yaml"));
}

TEST_CASE("outputs: renders of an earlier run are removed if its metrics list them") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, train("run"));
  const auto first = contents(folder / "run");
  check_refused(folder, train("run"), "--overwrite");
  put(folder / "run/renders/r_007.png", "my photograph");
  ubs_ok(folder, train("run", "--overwrite --save-renders 1"));
  CHECK(fs::exists(folder / "run/renders/r_000.png"));
  CHECK_FALSE(fs::exists(folder / "run/renders/r_001.png"));  // it belonged to the earlier run
  CHECK(get(folder / "run/renders/r_007.png") == "my photograph");
  CHECK(get(folder / "run/model.ply") == first.at("model.ply"));

  // Entries of the list that are not plain file names are ignored, so nothing is removed.
  nlohmann::json metrics = nlohmann::json::parse(get(folder / "run/metrics.json"));
  CHECK(metrics.at("renders") == nlohmann::json{"r_000.png"});
  put(folder / "mine.png", "precious");
  put(folder / "run/renders/inner/mine.png", "precious");
  metrics["renders"] = {"../../mine.png",
                        (folder / "mine.png").string(),
                        "inner/mine.png",
                        "inner",
                        "..",
                        7,
                        std::string("r_000.png\0.png", 14)};
  put(folder / "run/metrics.json", metrics.dump());
  ubs_ok(folder, train("run", "--overwrite --save-renders 0"));
  CHECK(get(folder / "mine.png") == "precious");
  CHECK(get(folder / "run/renders/inner/mine.png") == "precious");
  CHECK(fs::exists(folder / "run/renders/r_000.png"));
  const std::string deep = "{\"renders\": [\"r_000.png\"], \"deep\": " + std::string(200, '[') +
                           std::string(200, ']') + "}";  // nested more deeply than parse_json() accepts
  for (const std::string& damaged :
       {std::string(), std::string("[1]"), std::string("{\"renders\": 5}"), std::string("not json"), deep}) {
    put(folder / "run/metrics.json", damaged);
    ubs_ok(folder, train("run", "--overwrite --save-renders 0"));
    CHECK(fs::exists(folder / "run/renders/r_000.png"));
  }
}

TEST_CASE("outputs: results may be written to a new folder inside the data folder") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, train("run"));
  const auto data = contents(folder / "data");
  ubs_ok(folder, train("data/output"));
  ubs_ok(folder, train("data/output", "--overwrite"));  // must not read the first run as data
  ubs_ok(folder, "render data/output --out data/pictures");
  ubs_ok(folder, "render data/output --out data/pictures --overwrite");
  CHECK(get(folder / "data/output/model.ply") == get(folder / "run/model.ply"));
  for (const auto& [name, content] : data) {
    INFO(name);
    CHECK(get(folder / "data" / name) == content);
  }
}

// A folder with an arbitrary name can only be recognised by the images that the cameras refer to.
TEST_CASE("outputs: --overwrite does not replace photographs in a folder with an arbitrary name") {
  const TempFolder folder;
  synthesise(folder);
  fs::rename(folder / "data/test", folder / "data/photos");
  const std::string text =
      test::replaced(get(folder / "data/transforms_test.json"), "./test/r_000", "./photos/r_000");
  put(folder / "data/transforms_test.json", test::replaced(text, "./test/r_001", "./photos/r_001"));
  ubs_ok(folder, train("run"));
  check_refused(folder, "render run data --out data/photos --overwrite",
                "this folder contains images or cameras");
  check_refused(folder, train("data/photos", "--overwrite"), "this folder contains images or cameras");
  fs::rename(folder / "data/photos", folder / "data/renders");
  std::string moved = get(folder / "data/transforms_test.json");
  for (int i = 0; i < 2; ++i) moved = test::replaced(moved, "./photos/", "./renders/");
  put(folder / "data/transforms_test.json", moved);
  check_refused(folder, train("data", "--overwrite"), "is the data");
}

TEST_CASE("outputs: --overwrite replaces a run that was edited or copied") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, train("run", "--refine-cameras pose"));
  std::string config = get(folder / "run/config.yaml");
  put(folder / "run/config.yaml", config.replace(config.find("\niterations") + 1, 0, "# edited\n"));
  check_refused(folder, train("run", "--spec run/config.yaml"), "--overwrite");
  fs::copy(folder / "run", folder / "copy", fs::copy_options::recursive);
  ubs_ok(folder, train("run", "--spec run/config.yaml --overwrite"));
  ubs_ok(folder, train("copy", "--spec run/config.yaml --overwrite"));
  CHECK(get(folder / "copy/model.ply") == get(folder / "run/model.ply"));
}

// Starts `ubs train` with the output folder `run`, and runs `script` next to that folder as soon as a
// checkpoint exists. In the script, $pid is the process of `ubs train`.
Result beside_training(const TempFolder& folder, int iterations, const std::string& script) {
  put(folder / "script.sh",
      fmt::format(
          "ubs='{}'\n\"$ubs\" {} >run.txt 2>&1 & pid=$!\n"
          "i=0; until [ -s run/checkpoint.ubs ] || [ $i -ge 12000 ]; do sleep 0.05; i=$((i+1)); done\n"
          "{}\n",
          UBS_EXECUTABLE, train("run", "--checkpoint-every 20", iterations), script));
  return test::run_command(folder, "sh script.sh");
}

TEST_CASE("outputs: a copy of an interrupted run can be resumed") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, train("whole", "", 1500));
  const Result result =
      beside_training(folder, 1500, "kill -TERM $pid; wait $pid; echo \"code $?\"; cp -r run moved");
  REQUIRE(result.out == "code 130\n");
  for (const char* out : {"run", "moved"}) {
    INFO(out);
    ubs_ok(folder, fmt::format("train --resume {} --quiet", out));
    CHECK(get(folder / out / "model.ply") == get(folder / "whole/model.ply"));
    CHECK_FALSE(fs::exists(folder / out / "checkpoint.ubs"));
    check_refused(folder, train(out), "--overwrite");
    ubs_ok(folder, train(out, "--overwrite"));
  }
}

// A command that writes one file. In its arguments, OUT stands for this file.
struct Writer {
  const char* arguments;
  const char* input;  // a file that the command reads and therefore must not write, or null
};

const Writer kWriters[] = {
    {"eval --model run/model.ply --data data --fps-views 0 --out OUT", "run/model.ply"},
    {"metrics data/test/r_000.png data/test/r_001.png --out OUT", "data/test/r_000.png"},
    {"render run/model.ply --data data --video OUT", "run/model.ply"},
    {"convert run/model.ply OUT --to ubs", "run/model.ply"},
    {"convert run/model.ply OUT --to 3dgs --distill 0", "run/model.ply"},
    {"convert run/model.ply OUT --to spz --distill 0", "run/model.ply"},
    {"convert run/model.ply OUT --to splat --distill 0", "run/model.ply"},
    {"pack data --out OUT", nullptr},
    {"pack F.ubsd --out OUT", "F.ubsd"},
    {"gradients --model run/model.ply --data data --view 0 --out OUT", "run/model.ply"},
    {"reduce --model run/model.ply --data data --bound 0.1 --quiet --out OUT", "run/model.ply"},
    {"reduce --model run/model.ply --data data --bound 0.1 --quiet --out r.ply --effects OUT", "r.ply"},
    {"report run --out OUT", "run/metrics.json"},
    {"bench --quick --run '^adam.random' --json OUT", nullptr},
    {"bench --quick --run '^adam.random' --baseline b.json --json OUT", "b.json"},
    {"tune --quick --raster gpu --size 48x40/500 --json OUT", nullptr},
};

std::string with_out(std::string arguments, const std::string& out) {
  return arguments.replace(arguments.find("OUT"), 3, out);
}

TEST_CASE("outputs: commands replace a file only with --overwrite, and never their input") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, train("run"));
  ubs_ok(folder, "pack data --out F.ubsd");
  put(folder / "b.json", "{}");
  put(folder / "r.ply", "x");
  fs::remove(folder / "r.ply");
  for (const char* name : {"mine.mp4", "mine.png"}) put(folder / name, "precious");
  fs::create_symlink("mine.mp4", folder / "link.mp4");
  fs::create_symlink("nowhere", folder / "dangling.mp4");
  // Tests each command with an existing file as its output, and with one other output. The other outputs are
  // a symbolic link to a file, a symbolic link to nothing, the command's input file and a hard link to this
  // input file. The last two are only used for commands that read a file. With UBS_TEST_ALL=1, tests each
  // command with all of these outputs.
  const bool all = test::whole_sweep();
  std::size_t turn = 0;
  for (const Writer& writer : kWriters) {
    INFO(writer.arguments);
    check_refused(folder, with_out(writer.arguments, "mine.mp4"), "mine.mp4: already exists");
    const bool reads = writer.input && fs::exists(folder / writer.input);
    const std::size_t other = turn++ % (reads ? 4 : 2);
    for (std::size_t i = 0; const std::string link : {"link.mp4", "dangling.mp4"})
      if (const bool chosen = i++ == other; all || chosen)
        check_error(folder, with_out(writer.arguments, link) + " --overwrite", 3,
                    link + ": this is a symbolic link");
    if (!reads) continue;
    fs::remove(folder / "hard.mp4");
    fs::create_hard_link(folder / writer.input, folder / "hard.mp4");
    for (std::size_t i = 2; const std::string& out : {std::string(writer.input), std::string("hard.mp4")})
      if (const bool chosen = i++ == other; all || chosen)
        check_refused(folder, with_out(writer.arguments, out) + " --overwrite", "this is the input");
  }
  for (const char* command : {"convert --distill 0 run/model.ply mine.ply", "pack data --out mine.ubsd",
                              "metrics data/test/r_000.png data/test/r_001.png --out mine.json"}) {
    const std::string file = std::string(command).substr(std::string(command).find("mine"));
    put(folder / file, "old");
    check_refused(folder, command, file + ": already exists");
    ubs_ok(folder, fmt::format("{} --overwrite", command));
    CHECK(get(folder / file) != "old");
  }
  check_refused(folder, "reduce --model run/model.ply --data data --out x.ply --effects x.ply",
                "two results");
  for (const auto& [command, message] :
       {std::pair{"reduce run/model.ply data --out r.spz",
                  "r.spz: the output is a UBS model, not a .spz file: choose a name that ends with .ply"},
        {"reduce run/model.ply data --out r.ply --effects r.json", "r.json: the output is CSV"},
        {"web run/model.ply --out page.html --poster p.jpg", "p.jpg: the output is PNG"},
        {"web run/model.ply --out page.ply", "page.ply: the output is HTML"},
        {"eval run/model.ply data --out e.csv", "e.csv: the output is JSON"},
        {"metrics data/test/r_000.png data/test/r_001.png --out m.png", "m.png: the output is JSON"},
        {"report run --out r.json", "r.json: the output is HTML"},
        {"pack data --out p.mp4", "p.mp4: the output is a packed data set"},
        {"convert run/model.ply c.spz --to 3dgs --distill 0", "c.spz: the output is 3DGS PLY"}})
    check_refused(folder, command, message);
}

TEST_CASE("outputs: commands that write to a folder replace existing results only with --overwrite") {
  const TempFolder folder;
  synthesise(folder);
  ubs_ok(folder, train("run"));
  const std::map<std::string, std::string> commands{
      {"render run/model.ply --data data --out OUT", "r_000.png"},
      {"render run/model.ply --data data --channels depth --format npy --out OUT", "r_001_depth.npy"},
      {"compare --devices cpu --model run/model.ply --data data --out OUT", "compare.csv"},
      {"accuracy --quick --model run/model.ply --data data --out OUT", "accuracy.csv"},
      {"synth glossy --size 32 --views 4 --test-views 2 --out OUT", "transforms_test.json"}};
  for (std::size_t turn = 0; const auto& [arguments, name] : commands) {
    INFO(arguments);
    ++turn;
    put(folder / "other" / name, "precious");
    check_refused(folder, with_out(arguments, "other"), name + ": already exists");
    fs::remove_all(folder / "other");
    if (arguments.find("--data") == std::string::npos) continue;
    const std::pair<const char*, const char*> places[] = {
        {"data/test", "this folder contains images or cameras"},
        {"data", "is the data"},
        {".", "holds the data"}};
    // Tests each command with one of these places, or with all of them if UBS_TEST_ALL=1 is set.
    for (std::size_t i = 0; const auto& [place, message] : places)
      if (i++ == turn % 3 || test::whole_sweep()) check_refused(folder, with_out(arguments, place), message);
  }
  put(folder / "images/r_000.png", "old");
  put(folder / "images/mine.png", "precious");
  ubs_ok(folder, "render run/model.ply --data data --out images --overwrite");
  CHECK(get(folder / "images/r_000.png") != "old");
  CHECK(get(folder / "images/mine.png") == "precious");
  check_refused(folder, "render run/model.ply --data data --out run/renders", "r_000.png: already exists");
  // A view that is listed twice is written once, and a video shows it twice.
  const Result twice = ubs_ok(folder, "render run data --views 0,0 --out twice --video twice.avi");
  CHECK(twice.out.find("1 views of 'test'") != std::string::npos);
  CHECK(twice.out.find("2 frames") != std::string::npos);
  CHECK(get(folder / "twice/r_000.png") == get(folder / "images/r_000.png"));
  CHECK_FALSE(fs::exists(folder / "twice/.png"));
}

TEST_CASE("outputs: two processes do not write into one folder") {
  const TempFolder folder;
  synthesise(folder);
  const Result result = beside_training(
      folder, 1000000,
      fmt::format(
          "for a in '{} --overwrite' 'train --resume run --quiet'; do \"$ubs\" $a; echo \"code $?\"; done\n"
          "kill -9 $pid; wait $pid 2>/dev/null; \"$ubs\" train --resume run --quiet & pid=$!\n"
          "sleep 2; kill -TERM $pid; wait $pid; echo \"code $?\"",
          train("run")));
  INFO(result.err);
  CHECK(result.out == "code 2\ncode 2\ncode 130\n");  // the lock of the killed process is released
  CHECK(result.err.find("run: process ") != std::string::npos);
  CHECK(result.err.find("is writing to this folder") != std::string::npos);
}

}  // namespace
}  // namespace ubs
