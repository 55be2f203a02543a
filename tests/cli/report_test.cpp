// SPDX-License-Identifier: Apache-2.0
// ubs report as a user meets it: pages of short trainings on embedded scenes, read again tag by tag and
// picture by picture; comparisons; runs with parts missing; what it refuses.
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "host/data/dataset.hpp"
#include "host/data/ply.hpp"
#include "host/train/checkpoint.hpp"
#include "tests/support/html_check.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::contains;
using test::get;
using test::HtmlCheck;
using test::HtmlElement;
using test::put;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;
using Ids = std::set<std::string>;

// Trained once for all tests: runs 'still' (N = 6) and 'moving' (N = 7).
const TempFolder& trained() {
  static const TempFolder folder;
  static const bool done = [] {
    test::put_scene(folder / "data", 32, 6, 5);
    test::put_scene(folder / "<b>&data", 24, 6, 2, "orbit");
    const std::string common = "--device cpu --iterations 60 --init-points 150 --cap-max 200 --quiet";
    ubs_ok(folder, "train --data data --out still --eval-every 20 " + common);
    ubs_ok(folder, "train --data '<b>&data' --out '<i>moving' --dim 7 --eval-every 30 " + common);
    return true;
  }();
  REQUIRE(done);
  return folder;
}

// The elements of that name that have no attributes, as a browser hashes them; by coreutils, in hexadecimal
// digits.
std::vector<std::string> sha256(const std::string& page, const std::string& element) {
  const std::string open = "<" + element + ">";
  std::vector<std::string> hashes;
  for (std::size_t at = 0; (at = page.find(open, at)) != std::string::npos;) {
    at += open.size();
    const TempFolder folder;
    put(folder / "text", page.substr(at, page.find("</" + element + ">", at) - at));
    hashes.push_back(test::run_command(folder, "sha256sum text").out.substr(0, 64));
  }
  return hashes;
}

std::string hexadecimal(const std::string& base64) {
  std::string digits;
  for (const std::uint8_t byte : test::data_uri_bytes("data:x;base64," + base64, {"x"}))
    digits += fmt::format("{:02x}", byte);
  return digits;
}

// The first thing in the page that could fetch or run anything is the policy that forbids it, but for its
// style and its script and those of the live model, of which it has the hashes. Attributes with code or style
// would need more than that.
void check_policy(const std::string& page, const HtmlCheck& check) {
  const std::vector<HtmlElement> metas = check.all("meta");
  REQUIRE(metas.size() >= 2);
  CHECK(metas[0].at("charset") == "utf-8");
  REQUIRE(metas[1].at("http-equiv") == "Content-Security-Policy");
  std::map<std::string, std::string> policy;
  std::string content = metas[1].at("content");
  for (std::size_t at; (at = content.find("&#39;")) != std::string::npos;) content.replace(at, 5, 1, '\'');
  std::istringstream parts(content);
  for (std::string part; std::getline(parts >> std::ws, part, ';');)
    policy[part.substr(0, part.find(' '))] = part.substr(part.find(' ') + 1);
  const bool live = contains(page, "id=\"ubs-viewer\"");
  const std::set<std::string> data_types{"application/json", "application/octet-stream", "text/plain"};
  for (const std::string element : {"style", "script"}) {
    std::istringstream sources(policy[element + "-src"]);
    std::vector<std::string> hashes;
    for (std::string source; sources >> source;) {
      REQUIRE(source.starts_with("'sha256-"));
      hashes.push_back(hexadecimal(source.substr(8, source.size() - 9)));
    }
    CHECK(hashes.size() == (live ? 2 : 1));
    CHECK(hashes == sha256(page, element));
    std::size_t run = 0;  // what is no data
    for (const HtmlElement& e : check.all(element)) run += data_types.contains(e.at("type")) ? 0 : 1;
    CHECK(run == hashes.size());
    policy.erase(element + "-src");
  }
  std::map<std::string, std::string> rest{
      {"default-src", "'none'"}, {"img-src", "data:"}, {"base-uri", "'none'"}, {"form-action", "'none'"}};
  if (live) rest["worker-src"] = "blob:";
  CHECK(policy == rest);
  for (const HtmlElement& element : check.elements)
    for (const auto& [key, value] : element.attributes)
      CHECK_FALSE((key == "style" || (key.starts_with("on") && key.size() > 2)));
}

// A well-formed page that fetches nothing, all pictures of which can be decoded and are of the size that they
// say.
HtmlCheck read_page(const fs::path& path) {
  const std::string page = get(path);
  HtmlCheck check = test::check_html(page);
  CHECK(check.error == "");
  check_policy(page, check);
  CHECK_FALSE(contains(page, "://"));
  CHECK_FALSE(contains(page, "url("));
  for (const HtmlElement& e : check.elements)
    for (const char* key : {"src", "href"})
      if (const std::string value = e.at(key); !value.empty())
        CHECK((value.starts_with("data:image/") || value == "data:," ||  // no icon
               (value.starts_with("#") && check.ids().contains(value.substr(1)))));
  for (const HtmlElement& image : check.all("img")) {
    const cv::Mat pixels =
        cv::imdecode(test::data_uri_bytes(image.at("src"), {"image/png", "image/jpeg"}), cv::IMREAD_COLOR);
    REQUIRE_FALSE(pixels.empty());
    CHECK(std::to_string(pixels.cols) == image.at("width"));
    CHECK(std::to_string(pixels.rows) == image.at("height"));
  }
  return check;
}

// Pictures of the page by what they show, legends not counted.
std::map<std::string, int> pictures(const HtmlCheck& page) {
  std::map<std::string, int> count;
  for (const HtmlElement& image : page.all("img")) ++count[image.at("alt")];
  count.erase("colours");
  return count;
}

double brightness(const HtmlCheck& page, const std::string& alt) {
  for (const HtmlElement& image : page.all("img"))
    if (image.at("alt") == alt) {
      const cv::Scalar mean = cv::mean(
          cv::imdecode(test::data_uri_bytes(image.at("src"), {"image/png", "image/jpeg"}), cv::IMREAD_COLOR));
      return mean[0] + mean[1] + mean[2];
    }
  return -1;
}

TEST_CASE("report: page of one run", "[cli]") {
  const TempFolder& folder = trained();
  ubs_ok(folder, "report still --device cpu");
  const HtmlCheck page = read_page(folder / "still/report.html");
  CHECK(page.ids() == Ids{"viewer", "ubs-viewer", "ubs-options", "ubs-model", "ubs-worker", "summary",
                          "curves", "views", "decomposition", "parameters", "measurements", "settings",
                          "device"});
  CHECK(pictures(page) == std::map<std::string, int>{{"ground truth", 3},
                                                     {"render", 3},
                                                     {"error", 3},
                                                     {"depth", 3},
                                                     {"alpha", 3},
                                                     {"all splats", 2},
                                                     {"lower half", 2},
                                                     {"upper half", 2},
                                                     {"top tenth", 2}});
  for (const char* alt : {"ground truth", "render", "error", "depth", "alpha", "all splats"})
    CHECK(brightness(page, alt) > 3);
  for (const HtmlElement& image : page.all("img"))
    if (image.at("alt") != "colours") CHECK((image.at("width") == "32" && image.at("height") == "32"));

  const std::string text = get(folder / "still/report.html");
  const json metrics = json::parse(get(folder / "still/metrics.json"));
  CHECK(contains(text, fmt::format("{:.3f}", metrics["test"]["mean"]["psnr"].get<double>())));
  CHECK(contains(text, "3 of the 5 views of split &#39;test&#39;"));
  for (const char* part : {"raster_backward", "init_points", "device memory at most",
                           "direction conditioning", "Settings at their default", "prefers-color-scheme"})
    CHECK(contains(text, part));
  CHECK(page.all("circle").size() ==
        3 * 4);  // three evaluations: PSNR and SSIM, by iterations and by seconds
  CHECK(contains(get(folder / "stdout.txt"), fmt::format("page     still/report.html: {:.2f} MiB",
                                                         static_cast<double>(text.size()) / 1048576)));

  // The PSNR beside a picture is of 8-bit pixels; close to what training measured of the same view.
  const std::string mark = "render, ";
  const double shown = std::stod(text.substr(text.find(mark) + mark.size()));
  CHECK(shown == Approx(metrics["test"]["views"][0]["psnr"].get<double>()).margin(0.02));

  ubs_ok(folder, "report still --device cpu --views 1 --out small.html --json");
  const json made = json::parse(get(folder / "stdout.txt"));
  CHECK(made["out"] == "small.html");
  CHECK(made["bytes"] == get(folder / "small.html").size());
  CHECK(made["runs"][0]["views"] == 1);
  CHECK(pictures(read_page(folder / "small.html"))["render"] == 1);
  CHECK(contains(get(folder / "small.html"), "id=\"ubs-viewer\""));
  ubs_ok(folder, "report still --device cpu --views 1 --no-viewer --out plain.html --overwrite");
  read_page(folder / "plain.html");
  CHECK_FALSE(contains(get(folder / "plain.html"), "ubs-viewer"));

  json damaged = metrics;  // a name that is no text is that of no view
  damaged["test"]["views"][0]["name"] = 5;
  put(folder / "still/metrics.json", damaged.dump());
  ubs_ok(folder, "report still --device cpu --views 1 --no-viewer --out plain.html --overwrite");
  put(folder / "still/metrics.json", metrics.dump());
}

TEST_CASE("report: dynamic scenes and names that look like markup", "[cli]") {
  const TempFolder& folder = trained();
  ubs_ok(folder, "report '<i>moving' --device cpu --views 2 --out moving.html");
  const HtmlCheck page = read_page(folder / "moving.html");
  CHECK(page.ids().contains("times"));
  const auto count = pictures(page);
  CHECK(count.at("lower half") == 3);
  CHECK(count.at("render") == 2 + 6);
  const std::string text = get(folder / "moving.html");
  CHECK(contains(text, "at time "));
  CHECK(contains(text, "temporal beta"));
  CHECK(contains(text, "&lt;i&gt;moving"));
  CHECK(contains(text, "&lt;b&gt;&amp;data"));
  CHECK_FALSE(contains(text, "<i>moving"));
}

TEST_CASE("report: runs side by side", "[cli]") {
  const TempFolder& folder = trained();
  ubs_ok(folder,
         "train --data data --out other --dim 3 --device cpu --iterations 40 --init-points 150 "
         "--cap-max 200 "
         "--quiet --overwrite");
  CHECK(run_ubs(folder, "report still other").code == 2);
  CHECK(contains(get(folder / "stderr.txt"), "--out is required"));
  ubs_ok(folder, "report still other --device cpu --views 2 --out both.html");
  const HtmlCheck page = read_page(folder / "both.html");
  auto count = pictures(page);
  CHECK(count["ground truth"] == 2);  // once for both
  CHECK(count["render"] == 4);
  CHECK(count["error"] == 4);
  CHECK(count["lower half"] == 3);  // spatial and angular; spatial
  std::set<std::string> differ;
  std::size_t better_or_worse = 0;
  for (const HtmlElement& e : page.elements) {
    if (e.name == "span" && (e.at("class") == "better" || e.at("class") == "worse")) ++better_or_worse;
    if (e.name == "tr" && e.at("class") == "differ") differ.insert(e.name);
  }
  CHECK(better_or_worse >= 3);
  CHECK(differ.size() == 1);
  const std::string text = get(folder / "both.html");
  CHECK(contains(text, "ground truth as above"));
  CHECK(contains(text, "<tr class=\"differ\"><th><code>dim</code>"));
  CHECK(contains(text, "<tr><th><code>init_points</code>"));  // not the default, but the same

  // Of different scenes: each beside its own ground truth.
  ubs_ok(folder, "report still '<i>moving' --device cpu --views 1 --out scenes.html");
  CHECK(pictures(read_page(folder / "scenes.html"))["ground truth"] == 2);
}

TEST_CASE("report: runs with parts missing", "[cli]") {
  const TempFolder& folder = trained();
  const auto copy = [&](const char* to) {
    fs::create_directories((folder / to).parent_path());
    fs::copy(folder / "still", folder / to, fs::copy_options::recursive);
  };
  copy("away/run");
  fs::rename(folder / "data", folder / "data-moved");
  ubs_ok(folder, "report away/run --device cpu --overwrite");
  CHECK(contains(get(folder / "stderr.txt"), "data folder data is gone"));
  HtmlCheck page = read_page(folder / "away/run/report.html");
  CHECK(contains(get(folder / "away/run/report.html"), "around the model 1"));
  auto count = pictures(page);
  CHECK(count["ground truth"] == 3);  // that the run saved
  CHECK(count["render"] == 5);
  CHECK(count["depth"] == 2);
  CHECK(brightness(page, "alpha") > 3);

  fs::remove_all(folder / "away/run/renders");
  ubs_ok(folder, "report away/run --device cpu --overwrite");
  CHECK(contains(get(folder / "away/run/report.html"), "no ground truth: views from around the model"));
  count = pictures(read_page(folder / "away/run/report.html"));
  CHECK(count["ground truth"] == 0);
  CHECK(count["render"] == 2);
  ubs_ok(folder, "report away/run --device cpu --data data-moved --overwrite");
  CHECK(pictures(read_page(folder / "away/run/report.html"))["ground truth"] == 3);
  fs::rename(folder / "data-moved", folder / "data");

  copy("bare");
  for (const char* file : {"model.ply", "metrics.json", "config.yaml"}) fs::remove(folder / "bare" / file);
  ubs_ok(folder, "report bare --overwrite");
  page = read_page(folder / "bare/report.html");
  CHECK(page.ids() == Ids{"summary", "curves", "device"});
  CHECK(contains(get(folder / "bare/report.html"), "model.ply is missing"));

  copy("mixed");  // reduced to several dimensions
  SplatModel flat(3, 40);
  for (std::size_t i = 0; i < flat.values.size(); ++i) flat.values[i] = std::sin(static_cast<float>(i));
  const SplatModel whole = read_splat_ply(folder / "still/model.ply");
  fs::remove(folder / "mixed/model.ply");
  write_mixed_ply(folder / "mixed/model.ply", MixedModel(std::vector<SplatModel>{whole, flat}));
  fs::remove(folder / "mixed/log.csv");
  ubs_ok(folder, "report mixed --device cpu --views 1 --overwrite");
  page = read_page(folder / "mixed/report.html");
  CHECK_FALSE(page.ids().contains("curves"));
  CHECK(pictures(page)["lower half"] == 2);
}

TEST_CASE("report: other data in the place of the run's are not its ground truth", "[cli]") {
  const TempFolder& folder = trained();
  const TempFolder there, here;
  test::put_scene(there / "data", 32, 4, 5);
  fs::create_directories(there / "runs/a");
  fs::copy(folder / "still", there / "runs/a/still", fs::copy_options::recursive);
  fs::remove_all(there / "runs/a/still/renders");
  const std::string run = (there / "runs/a/still").string();
  const auto truths = [&](const TempFolder& from, const std::string& arguments) {
    ubs_ok(from, "report " + run + "/ --device cpu --views 1 --out page.html --overwrite" + arguments);
    return pictures(read_page(from / "page.html"))["ground truth"];
  };
  // From a folder above the run nothing is taken; from the working folder only what the run was trained on.
  CHECK(truths(here, "") == 0);
  CHECK(contains(get(here / "stderr.txt"), "data folder data is gone"));
  CHECK(truths(there, "") == 0);
  CHECK(contains(get(there / "stderr.txt"), "data in data are not those that the run was trained on"));
  CHECK(truths(there, " --data data") == 1);
  CHECK(contains(get(there / "stderr.txt"), "data in data are not those that the run was trained on"));
  fs::copy(folder / "data", there / "runs/a/data", fs::copy_options::recursive);
  for (const TempFolder* from : {&there, &here}) {
    CHECK(truths(*from, "") == 1);
    CHECK_FALSE(contains(get(*from / "stderr.txt"), "data"));
  }
}

// Ended by the signal, when there is a checkpoint.
void ended_run(const TempFolder& folder, const std::string& out, int signal) {
  test::ended_by(folder,
                 "train --data data --out " + out +
                     " --device cpu --iterations 100000 --init-points 150 --cap-max 200 --log-every 10 "
                     "--checkpoint-every 50 --eval-every 50 --quiet",
                 signal, out + "/checkpoint.ubs");
}

TEST_CASE("report: runs that were killed and interrupted, beside a finished one", "[cli]") {
  const TempFolder& folder = trained();
  ended_run(folder, "killed", SIGKILL);
  REQUIRE(fs::exists(folder / "killed/checkpoint.ubs"));
  REQUIRE_FALSE(fs::exists(folder / "killed/model.ply"));
  ubs_ok(folder, "report killed --device cpu");
  HtmlCheck page = read_page(folder / "killed/report.html");
  // There is no metrics.json: data, splats and views are those that the checkpoint names.
  CHECK(page.ids().contains("curves"));
  CHECK(page.ids().contains("views"));
  CHECK(page.ids().contains("parameters"));
  CHECK(pictures(page)["ground truth"] == 3);
  CHECK(pictures(page)["lower half"] == 2);
  CHECK(brightness(page, "render") > 3);
  std::string text = get(folder / "killed/report.html");
  CHECK(contains(text, "the model is that of the checkpoint, iteration "));
  CHECK(contains(text, "metrics.json is missing: the run was not finished"));
  CHECK(contains(get(folder / "stderr.txt"), "model.ply is missing"));
  CHECK(contains(get(folder / "stdout.txt"), "N = 6"));

  ended_run(folder, "stopped", SIGINT);
  REQUIRE(json::parse(get(folder / "stopped/metrics.json"))["interrupted"] == true);
  ubs_ok(folder, "report still stopped killed --device cpu --views 1 --out three.html");
  page = read_page(folder / "three.html");
  CHECK(pictures(page)["ground truth"] == 1);
  CHECK(pictures(page)["render"] == 3);
  text = get(folder / "three.html");
  CHECK(contains(text, "interrupted"));
  CHECK(contains(text, "finished"));

  // A checkpoint that is damaged is an error, and no page is left.
  put(folder / "killed/checkpoint.ubs", get(folder / "killed/checkpoint.ubs").substr(0, 1000));
  CHECK(run_ubs(folder, "report killed --device cpu --out no.html").code == 3);
  CHECK(contains(get(folder / "stderr.txt"), "checkpoint.ubs"));
  CHECK_FALSE(fs::exists(folder / "no.html"));
}

TEST_CASE("report: a run that was killed later, with the background and the lenses that it has learnt",
          "[cli]") {
  const TempFolder& folder = trained();
  const fs::path run = folder / "continued";
  fs::copy(folder / "still", run, fs::copy_options::recursive);
  const json metrics = json::parse(get(run / "metrics.json"));
  Checkpoint later;
  later.settings.dim = 6;
  later.settings.background.learnt = Background::Learnt::colour;
  later.state.iteration = 100;
  later.state.model = read_splat_ply(run / "model.ply");
  later.state.sky.assign(81, 1.0f);
  later.data_print =
      fingerprint(*load_dataset(folder / "data", {.background = {1, 1, 1}}).find("train"));  // as learnt
  write_checkpoint(run / "checkpoint.ubs", later);
  std::string config = get(run / "config.yaml");
  const std::string none = "refine_cameras: none";
  put(run / "config.yaml", config.replace(config.find(none), none.size(), "refine_cameras: pose+intrinsics"));
  json cameras;  // that see the object as a point
  for (const json& view : metrics["test"]["views"])
    cameras["frames"].push_back(
        {{"file_path", "test/" + view["name"].get<std::string>() + ".png"},
         {"transform_matrix", {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}},
         {"fl_x", 0.1},
         {"fl_y", 0.1},
         {"cx", 16},
         {"cy", 16}});
  put(run / "cameras/transforms.json", cameras.dump());
  ubs_ok(folder, "report continued --device cpu --views 1 --no-viewer --overwrite");
  CHECK(contains(get(folder / "stderr.txt"), "model.ply is older: the model is that of the checkpoint"));
  CHECK(brightness(read_page(run / "report.html"), "render") > 750);  // 765: white
}

TEST_CASE("report: what it refuses", "[cli]") {
  const TempFolder& folder = trained();
  const auto refused = [&](const std::string& arguments, int code, const std::string& message) {
    CHECK(run_ubs(folder, "report " + arguments).code == code);
    CHECK(contains(get(folder / "stderr.txt"), message));
    CHECK_FALSE(fs::exists(folder / "no.html"));
  };
  refused("", 2, "runs");
  refused("nowhere --out no.html", 3, "no such folder");
  refused("data --out no.html", 3, "no output folder of 'ubs train'");
  refused("still/log.csv --out no.html", 3, "is no folder");
  refused("still --out data", 2, "is a folder");
  refused("still --views 0", 2, "--views");
  refused("still --out no.html --data nowhere", 3, "nowhere");
  refused("still --out no.html --device nosuch", 4, "nosuch");
  put(folder / "broken/model.ply", "ply\nnonsense");
  refused("broken --out no.html", 3, "model.ply");
}

}  // namespace
}  // namespace ubs
