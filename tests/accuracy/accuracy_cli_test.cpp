// SPDX-License-Identifier: Apache-2.0
// ubs accuracy and ubs curve as processes: files, fronts, comparison with a baseline and its exit code,
// refusals.
#include <sys/wait.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>

#include "host/accuracy/csv.hpp"
#include "host/data/image.hpp"
#include "tests/support/temp_folder.hpp"

namespace ubs {
namespace {

using Catch::Contains;
using nlohmann::json;
using test::get;
using test::put;
using test::TempFolder;

struct Result {
  int code;
  std::string out, err;
};

Result ubs(const TempFolder& folder, const std::string& arguments) {
  const std::string command = fmt::format("cd '{}' && '{}' {} >stdout.txt 2>stderr.txt </dev/null",
                                          folder.path().string(), UBS_EXECUTABLE, arguments);
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, get(folder / "stdout.txt"),
          get(folder / "stderr.txt")};
}

// With every number of a column times a factor.
std::string scaled(const std::string& csv, std::size_t column, double factor) {
  std::string text;
  for (std::size_t at = 0, line = 0; at < csv.size(); ++line) {
    const std::size_t end = csv.find('\n', at);
    std::string row = csv.substr(at, end - at);
    at = end + 1;
    if (line > 0) {
      std::size_t begin = 0;
      for (std::size_t k = 0; k < column; ++k) begin = row.find(',', begin) + 1;
      const std::size_t length = row.find(',', begin) - begin;
      row.replace(begin, length, std::to_string(std::stod(row.substr(begin, length)) * factor));
    }
    text += row + "\n";
  }
  return text;
}

TEST_CASE("accuracy: files, front, baseline") {
  const TempFolder folder;
  const std::string run =
      "accuracy --quick --config fast:math=rough --config 'never:tile=8,raster=gpu' --out ";
  const Result first = ubs(folder, run + "a");
  INFO(first.err);
  REQUIRE(first.code == 0);
  CHECK_THAT(first.out, Contains("| 1 | default |") && Contains("| 2 | fast |"));
  const json file = json::parse(get(folder / "a/accuracy.json"));
  CHECK_THAT(file.at("truth").get<std::string>(), Contains("float64"));
  const json& results = file.at("results");
  REQUIRE(results.size() == 3);
  CHECK(results[0].at("image").at("relative") < 1e-5);
  CHECK(results[1].at("image").at("relative") > 1e-5);
  CHECK(results[0].at("image_front"));
  CHECK(results[0].at("stages").contains("lists + raster_forward"));
  CHECK_THAT(results[2].at("note").get<std::string>(), Contains("raster = cpu"));
  CHECK(load_image(folder / "a/accuracy.png").width > 1000);
  CHECK_THAT(get(folder / "a/accuracy.md"),
             Contains("![error against time](accuracy.png)") && Contains("* truth: float64"));

  const std::string csv = get(folder / "a/accuracy.csv");
  const Result same = ubs(folder, run + "b --baseline a/accuracy.csv");
  CHECK(same.code == 0);
  CHECK_THAT(same.out, Contains("0 of "));
  CHECK(get(folder / "b/accuracy.csv").size() > 1000);
  // The device's name stands in quotes where it has commas.
  const std::size_t column =
      6 +
      static_cast<std::size_t>(
          std::count(csv.begin(), csv.begin() + static_cast<std::ptrdiff_t>(csv.find(",glossy,")), ',')) -
      static_cast<std::size_t>(
          std::count(csv.begin(), csv.begin() + static_cast<std::ptrdiff_t>(csv.find('\n')), ','));
  put(folder / "better.csv", scaled(csv, column, 0.01));
  const Result worse = ubs(folder, run + "c --baseline better.csv");
  CHECK(worse.code == 8);
  CHECK_THAT(worse.out, Contains("WORSE"));
}

TEST_CASE("accuracy: what is refused") {
  const TempFolder folder;
  CHECK(ubs(folder, "accuracy --quick").code == 2);
  CHECK(ubs(folder, "accuracy --quick --out a --config x:maths=native").code == 2);
  CHECK(ubs(folder, "accuracy --quick --out a --model m.ply").code == 2);
  CHECK(ubs(folder, "accuracy --quick --out a --baseline none.csv").code == 3);
  const Result none = ubs(
      folder, "accuracy --quick --out a --config default:tile=8,raster=gpu --config 'x:tile=8,raster=gpu'");
  CHECK(none.code == 0);  // the default runs beside them
}

TEST_CASE("curve: files and baseline") {
  const TempFolder folder;
  const std::string run = "curve --quick --config a:dim=3 --config b:dim=6,math=native --out ";
  const Result first = ubs(folder, run + "a");
  INFO(first.err);
  REQUIRE(first.code == 0);
  const auto rows =
      accuracy::read_csv(folder / "a/curve.csv", {"configuration", "iteration", "seconds", "psnr", "ssim"});
  REQUIRE(rows.size() == 40);  // 60 iterations, evaluated every third
  CHECK(rows[0].at("configuration") == "a");
  CHECK(rows[0].at("iteration") == "3");
  CHECK(rows[39].at("configuration") == "b");
  CHECK(std::stod(rows[19].at("psnr")) > std::stod(rows[0].at("psnr")));
  CHECK(load_image(folder / "a/curve.png").width > 1000);
  CHECK(json::parse(get(folder / "a/curve.json")).at("curves").size() == 2);

  std::string csv = get(folder / "a/curve.csv");
  // Quality is a function of settings, data and device: the same again, also with the trainings one by one.
  const Result same = ubs(folder, run + "b --sequential --baseline a/curve.csv");
  CHECK(same.code == 0);
  CHECK_THAT(same.out, Contains("+0.000"));
  const std::string last = rows[39].at("psnr");
  const std::size_t at = csv.rfind("," + last + ",");
  csv.replace(at + 1, last.size(), "99");
  put(folder / "better.csv", csv);
  CHECK(ubs(folder, run + "c --baseline better.csv").code == 8);
  CHECK(ubs(folder, "curve --quick --config a:dim=3 --config a:dim=6 --out d").code == 2);
  CHECK(ubs(folder,
            "curve --quick --config a:dim=3,kernel=gaussian,rot_mode=quaternion,raster=gpu,tile=8 --out d")
            .code == 2);
}

}  // namespace
}  // namespace ubs
