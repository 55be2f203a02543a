// SPDX-License-Identifier: Apache-2.0
// Tests `ubs report` as users run it, with short runs on built-in scenes: the data and images of the pages,
// comparisons of runs, runs with missing files, and invalid arguments. tests/report/report_page_test.py tests
// the pages in a browser.
#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "host/dataset/load_dataset.hpp"
#include "host/formats/ply.hpp"
#include "host/train/checkpoint.hpp"
#include "tests/support/html_check.hpp"
#include "tests/support/made_scene.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

namespace fs = std::filesystem;
using Catch::Contains;
using nlohmann::json;
using test::contains;
using test::get;
using test::HtmlCheck;
using test::HtmlElement;
using test::put;
using test::run_ubs;
using test::TempFolder;
using test::ubs_ok;

// Returns a folder with the runs 'still' (N = 6) and '<i>moving' (N = 7), which are trained once for all
// tests.
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

// Returns the SHA-256 hashes of the contents of all elements with this name and without attributes, as
// hexadecimal digits. A browser computes the same hashes.
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

// The policy must come before everything in the page that could load or run something. It only allows the
// style and script of the page and of the interactive model, by their hashes. Attributes with code or style
// would need a weaker policy.
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
    std::size_t run = 0;  // elements that are not data
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

struct Page {
  HtmlCheck html;
  json record;
  std::map<std::string, std::vector<cv::Mat>> pictures;  // images by their kind, for example "render"
};

// Returns the content of the page. Checks that the page is well-formed and uses no network, and that all its
// images can be decoded and are used.
Page read_page(const fs::path& path) {
  const std::string text = get(path);
  Page page{test::check_html(text), {}, {}};
  CHECK(page.html.error == "");
  check_policy(text, page.html);
  for (const HtmlElement& e : page.html.elements)  // "data:," is an empty icon
    for (const char* key : {"src", "href"}) CHECK((e.at(key).empty() || e.at(key) == "data:,"));
  const auto data = [&](const std::string& id) {
    const std::string open = "<script id=\"" + id + "\" type=\"application/json\">";
    REQUIRE(contains(text, open));
    const std::size_t begin = text.find(open) + open.size();
    return json::parse(text.substr(begin, text.find("</script>", begin) - begin));
  };
  page.record = data("ubs-record");
  std::vector<cv::Mat> all;
  for (const json& uri : data("ubs-pictures")) {
    all.push_back(cv::imdecode(test::data_uri_bytes(uri.get<std::string>(), {"image/png", "image/jpeg"}),
                               cv::IMREAD_COLOR));
    REQUIRE_FALSE(all.back().empty());
  }
  std::set<std::size_t> used;
  const auto add = [&](const std::string& kind, const json& number) {
    const std::size_t n = number.get<std::size_t>();
    if (used.insert(n).second) page.pictures[kind].push_back(all.at(n));
  };
  for (const json& view : page.record["views"])
    for (const json& run : view["runs"])
      for (const char* kind : {"truth", "render", "error", "depth", "alpha"})
        if (run.contains(kind)) add(kind, run[kind]);
  for (const json& decomposition : page.record["decompositions"])
    for (const json& part : decomposition["parts"]) add(part["name"], part["picture"]);
  for (const json& strip : page.record["times"])
    for (const json& at : strip["pictures"]) add("time", at["picture"]);
  CHECK(used.size() == all.size());
  return page;
}

std::map<std::string, std::size_t> counts(const Page& page) {
  std::map<std::string, std::size_t> count;
  for (const auto& [kind, pictures] : page.pictures) count[kind] = pictures.size();
  return count;
}

// Returns the sum of the mean red, green and blue values of the first image of this kind. It is at most 765.
double brightness(const Page& page, const std::string& kind) {
  const cv::Scalar mean = cv::mean(page.pictures.at(kind).at(0));
  return mean[0] + mean[1] + mean[2];
}

bool has_histogram(const Page& page, const std::string& name) {
  for (const json& histogram : page.record["histograms"])
    if (histogram["name"] == name) return true;
  return false;
}

TEST_CASE("report: the page of one run contains its data", "[cli]") {
  const TempFolder& folder = trained();
  ubs_ok(folder, "report still --device cpu");
  const Page page = read_page(folder / "still/report.html");
  CHECK(page.html.ids() == std::set<std::string>{"ubs-viewer", "ubs-options", "ubs-model", "ubs-worker",
                                                 "ubs-record", "ubs-pictures"});
  CHECK(page.record["viewer"]["run"] == 0);
  CHECK(page.record["viewer"]["psnr"] >= 50);
  CHECK(counts(page) == std::map<std::string, std::size_t>{{"truth", 3},
                                                           {"render", 3},
                                                           {"error", 3},
                                                           {"depth", 3},
                                                           {"alpha", 3},
                                                           {"all splats", 2},
                                                           {"lower half", 2},
                                                           {"upper half", 2},
                                                           {"top tenth", 2}});
  for (const auto& [kind, pictures] : page.pictures)
    for (const cv::Mat& picture : pictures) CHECK((picture.cols == 32 && picture.rows == 32));
  for (const char* kind : {"truth", "render", "error", "depth", "alpha", "all splats"})
    CHECK(brightness(page, kind) > 3);

  const json metrics = json::parse(get(folder / "still/metrics.json")), &run = page.record["runs"][0];
  CHECK(page.record["title"] == "still");
  CHECK(run["metrics"] == metrics);
  CHECK_THAT(run["views_from"], Contains("3 of the 5 views of split 'test'"));
  CHECK(run["settings"]["init_points"] == "150");
  CHECK(page.record["defaults"]["init_points"] != "150");
  std::size_t tested = 0;
  for (const json& psnr : run["log"]["test_psnr"]) tested += psnr.is_number();
  CHECK(tested == 3);
  CHECK(has_histogram(page, "direction conditioning"));
  for (const json& histogram : page.record["histograms"]) {
    CHECK(histogram["edges"].size() == histogram["runs"][0]["share"].size() + 1);
    CHECK(histogram["runs"][0]["values"] > 0);
  }
  CHECK(contains(get(folder / "stdout.txt"),
                 fmt::format("page     still/report.html: {:.2f} MiB",
                             static_cast<double>(fs::file_size(folder / "still/report.html")) / 1048576)));

  // The PSNR next to an image is computed from 8-bit pixels, so it is close to what training measured for the
  // same view.
  const json& view = page.record["views"][0];
  CHECK(view["name"] == metrics["test"]["views"][0]["name"]);
  CHECK(view["runs"][0]["psnr"].get<double>() ==
        Approx(metrics["test"]["views"][0]["psnr"].get<double>()).margin(0.02));

  ubs_ok(folder, "report still --device cpu --views 1 --out small.html --json");
  const json made = json::parse(get(folder / "stdout.txt"));
  const Page small = read_page(folder / "small.html");
  CHECK(made["out"] == "small.html");
  CHECK(made["bytes"] == fs::file_size(folder / "small.html"));
  for (const char* part : {"runs", "views", "histograms"}) CHECK(made[part] == small.record[part]);
  CHECK(counts(small)["render"] == 1);
  CHECK(small.html.ids().contains("ubs-viewer"));
  ubs_ok(folder, "report still --device cpu --views 1 --no-viewer --out plain.html --overwrite");
  CHECK_FALSE(read_page(folder / "plain.html").html.ids().contains("ubs-viewer"));

  json damaged = metrics;  // the report must accept a name that is not a string, and find no view for it
  damaged["test"]["views"][0]["name"] = 5;
  put(folder / "still/metrics.json", damaged.dump());
  ubs_ok(folder, "report still --device cpu --views 1 --no-viewer --out plain.html --overwrite");
  put(folder / "still/metrics.json", metrics.dump());
}

TEST_CASE("report: a page can show dynamic scenes, and names that look like markup", "[cli]") {
  const TempFolder& folder = trained();
  ubs_ok(folder, "report '<i>moving' --device cpu --views 2 --out moving.html");
  const Page page = read_page(folder / "moving.html");
  CHECK(counts(page)["lower half"] == 3);
  CHECK(counts(page)["render"] == 2);
  CHECK(counts(page)["time"] == 6);
  CHECK(page.record["decompositions"][2]["kind"] == "temporal");
  CHECK(page.record["views"][0]["time"].is_number());
  CHECK(page.record["runs"][0]["name"] == "<i>moving");
  CHECK(page.record["runs"][0]["metrics"]["data"] == "<b>&data");
  const std::string text = get(folder / "moving.html");
  CHECK(contains(text, "<title>&lt;i&gt;moving</title>"));
  CHECK_FALSE(contains(text, "<i>moving"));
  CHECK_FALSE(contains(text, "<b>&data"));
}

TEST_CASE("report: a page can compare several runs", "[cli]") {
  const TempFolder& folder = trained();
  ubs_ok(folder,
         "train --data data --out other --dim 3 --device cpu --iterations 40 --init-points 150 "
         "--cap-max 200 "
         "--quiet --overwrite");
  CHECK(run_ubs(folder, "report still other").code == 2);
  CHECK(contains(get(folder / "stderr.txt"), "--out is required"));
  ubs_ok(folder, "report still other --device cpu --views 2 --out both.html");
  const Page page = read_page(folder / "both.html");
  auto count = counts(page);
  CHECK(count["truth"] == 2);  // both runs are compared with the same two photographs
  CHECK(count["render"] == 4);
  CHECK(count["error"] == 4);
  CHECK(count["lower half"] == 3);  // two for the first run, one for the second
  CHECK(page.record["title"] == "still / other");
  CHECK(page.record["runs"][0]["settings"]["dim"] != page.record["runs"][1]["settings"]["dim"]);
  CHECK(page.record["histograms"][0]["runs"].size() == 2);

  // Runs of different scenes are each shown with their own ground truth.
  ubs_ok(folder, "report still '<i>moving' --device cpu --views 1 --out scenes.html");
  CHECK(counts(read_page(folder / "scenes.html"))["truth"] == 2);
}

TEST_CASE("report: a run with missing files still gives a page", "[cli]") {
  const TempFolder& folder = trained();
  const auto copy = [&](const char* to) {
    fs::create_directories((folder / to).parent_path());
    fs::copy(folder / "still", folder / to, fs::copy_options::recursive);
  };
  copy("away/run");
  fs::rename(folder / "data", folder / "data-moved");
  ubs_ok(folder, "report away/run --device cpu --overwrite");
  CHECK(contains(get(folder / "stderr.txt"), "data folder data does not exist"));
  Page page = read_page(folder / "away/run/report.html");
  CHECK(page.record["views"].back()["name"] == "around the model 2");
  auto count = counts(page);
  CHECK(count["truth"] == 3);  // images that the run saved
  CHECK(count["render"] == 5);
  CHECK(count["depth"] == 2);
  CHECK(brightness(page, "alpha") > 3);

  fs::remove_all(folder / "away/run/renders");
  ubs_ok(folder, "report away/run --device cpu --overwrite");
  page = read_page(folder / "away/run/report.html");
  CHECK(page.record["runs"][0]["views_from"] == "no ground truth: views from around the model");
  count = counts(page);
  CHECK(count["truth"] == 0);
  CHECK(count["render"] == 2);
  ubs_ok(folder, "report away/run --device cpu --data data-moved --overwrite");
  CHECK(counts(read_page(folder / "away/run/report.html"))["truth"] == 3);
  fs::rename(folder / "data-moved", folder / "data");

  copy("bare");
  for (const char* file : {"model.ply", "metrics.json", "config.yaml"}) fs::remove(folder / "bare" / file);
  ubs_ok(folder, "report bare --overwrite");
  page = read_page(folder / "bare/report.html");
  CHECK(page.record["views"].empty());
  CHECK(page.record["histograms"].empty());
  CHECK(page.record["runs"][0]["metrics"].is_null());
  CHECK(page.record["runs"][0]["log"]["loss"].size() > 0);
  CHECK_THAT(page.record["runs"][0]["remarks"].dump(), Contains("model.ply is missing"));

  copy("mixed");  // gets a model whose splats have different dimensions, as `ubs reduce` writes
  SplatModel flat(3, 40);
  for (std::size_t i = 0; i < flat.values.size(); ++i) flat.values[i] = std::sin(static_cast<float>(i));
  const SplatModel whole = read_splat_ply(folder / "still/model.ply");
  fs::remove(folder / "mixed/model.ply");
  write_mixed_ply(folder / "mixed/model.ply", MixedModel(std::vector<SplatModel>{whole, flat}));
  fs::remove(folder / "mixed/log.csv");
  ubs_ok(folder, "report mixed --device cpu --views 1 --overwrite");
  page = read_page(folder / "mixed/report.html");
  CHECK(page.record["runs"][0]["log"].is_null());
  CHECK(counts(page)["lower half"] == 2);
}

TEST_CASE("report: ground truth comes from the data of the run, unless --data selects others", "[cli]") {
  const TempFolder& folder = trained();
  const TempFolder there, here;
  test::put_scene(there / "data", 32, 4, 5);
  fs::create_directories(there / "runs/a");
  fs::copy(folder / "still", there / "runs/a/still", fs::copy_options::recursive);
  fs::remove_all(there / "runs/a/still/renders");
  const std::string run = (there / "runs/a/still").string();
  const auto truths = [&](const TempFolder& from, const std::string& arguments) {
    ubs_ok(from, "report " + run + "/ --device cpu --views 1 --out page.html --overwrite" + arguments);
    return counts(read_page(from / "page.html"))["truth"];
  };
  // The folder there/data is not next to the run, so it is not searched. Data in the working folder are only
  // used if the run was trained on them, or if --data selects them.
  CHECK(truths(here, "") == 0);
  CHECK(contains(get(here / "stderr.txt"), "data folder data does not exist"));
  CHECK(truths(there, "") == 0);
  CHECK(contains(get(there / "stderr.txt"), "data is not the data that the run was trained on"));
  CHECK(truths(there, " --data data") == 1);
  CHECK(contains(get(there / "stderr.txt"), "data is not the data that the run was trained on"));
  // The data next to the run are those that the run was trained on, so they are used.
  fs::copy(folder / "data", there / "runs/a/data", fs::copy_options::recursive);
  for (const TempFolder* from : {&there, &here}) {
    CHECK(truths(*from, "") == 1);
    CHECK_FALSE(contains(get(*from / "stderr.txt"), "data"));
  }
}

// Starts `ubs train`, and sends it the signal as soon as it has written a checkpoint.
void ended_run(const TempFolder& folder, const std::string& out, int signal) {
  test::ended_by(folder,
                 "train --data data --out " + out +
                     " --device cpu --iterations 100000 --init-points 150 --cap-max 200 --log-every 10 "
                     "--checkpoint-every 50 --eval-every 50 --quiet",
                 signal, out + "/checkpoint.ubs");
}

TEST_CASE("report: a page can contain killed and interrupted runs", "[cli]") {
  const TempFolder& folder = trained();
  ended_run(folder, "killed", SIGKILL);
  REQUIRE(fs::exists(folder / "killed/checkpoint.ubs"));
  REQUIRE_FALSE(fs::exists(folder / "killed/model.ply"));
  ubs_ok(folder, "report killed --device cpu");
  Page page = read_page(folder / "killed/report.html");
  // There is no metrics.json, so data, splats and views come from the checkpoint.
  CHECK(page.record["runs"][0]["log"]["loss"].size() > 0);
  CHECK(has_histogram(page, "opacity"));
  CHECK(counts(page)["truth"] == 3);
  CHECK(counts(page)["lower half"] == 2);
  CHECK(brightness(page, "render") > 3);
  CHECK_THAT(page.record["runs"][0]["remarks"].dump(),
             Contains("showing the model of the checkpoint at iteration ") &&
                 Contains("metrics.json is missing: the run was not finished"));
  CHECK(contains(get(folder / "stderr.txt"), "model.ply is missing"));
  CHECK(contains(get(folder / "stdout.txt"), "N = 6"));

  ended_run(folder, "stopped", SIGTERM);
  REQUIRE(json::parse(get(folder / "stopped/metrics.json"))["interrupted"] == true);
  ubs_ok(folder, "report still stopped killed --device cpu --views 1 --out three.html");
  page = read_page(folder / "three.html");
  CHECK(counts(page)["truth"] == 1);
  CHECK(counts(page)["render"] == 3);
  CHECK(page.record["runs"][0]["metrics"]["interrupted"] == false);
  CHECK(page.record["runs"][1]["metrics"]["interrupted"] == true);
  CHECK(page.record["runs"][2]["metrics"].is_null());

  // A damaged checkpoint is an error, and no page is written.
  put(folder / "killed/checkpoint.ubs", get(folder / "killed/checkpoint.ubs").substr(0, 1000));
  CHECK(run_ubs(folder, "report killed --device cpu --out no.html").code == 3);
  CHECK(contains(get(folder / "stderr.txt"), "checkpoint.ubs"));
  CHECK_FALSE(fs::exists(folder / "no.html"));
}

TEST_CASE("report: if a checkpoint is newer than the model, its learnt background and lenses are displayed",
          "[cli]") {
  const TempFolder& folder = trained();
  const fs::path run = folder / "continued";
  fs::copy(folder / "still", run, fs::copy_options::recursive);
  const json metrics = json::parse(get(run / "metrics.json"));
  Checkpoint later;
  later.settings.dim = 6;
  later.settings.iterations = 200;
  later.settings.background.learnt = Background::Learnt::colour;
  later.state.iteration = 100;
  later.state.model = read_splat_ply(run / "model.ply");
  later.state.sky.assign(81, 1.0f);
  // The images are composited over the learnt background, which is white.
  later.data_print = fingerprint(*load_dataset(folder / "data", {.background = {1, 1, 1}}).find("train"));
  write_checkpoint(run / "checkpoint.ubs", later);
  std::string config = get(run / "config.yaml");
  const std::string none = "refine_cameras: none";
  put(run / "config.yaml", config.replace(config.find(none), none.size(), "refine_cameras: pose+intrinsics"));
  json cameras;  // with such a short focal length that the object is as small as a point
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
  CHECK(contains(get(folder / "stderr.txt"), "model.ply is older: showing the model of the checkpoint"));
  CHECK(brightness(read_page(run / "report.html"), "render") > 750);  // 765 is white
}

// Replaces the value of a setting in a config.yaml.
void set_in_config(const fs::path& run, const std::string& key, const std::string& value) {
  std::string text = get(run / "config.yaml");
  const std::size_t at = text.find(key + ": ");
  REQUIRE(at != std::string::npos);
  put(run / "config.yaml", text.replace(at, text.find('\n', at) - at, key + ": " + value));
}

// Converts the data set to the layout nerfstudio, with a lens distortion, so that images are undistorted.
void distort(const fs::path& data) {
  json all{{"k1", 0.05}, {"w", 32}, {"h", 32}, {"frames", json::array()}};
  for (const std::string split : {"train", "test"}) {
    const json part = json::parse(get(data / ("transforms_" + split + ".json")));
    all["fl_x"] = 16 / std::tan(part["camera_angle_x"].get<double>() / 2);
    for (const json& frame : part["frames"]) {
      const std::string file = frame["file_path"].get<std::string>() + ".png";
      all["frames"].push_back({{"file_path", file}, {"transform_matrix", frame["transform_matrix"]}});
      all[split + "_filenames"].push_back(file);
    }
    fs::remove(data / ("transforms_" + split + ".json"));
  }
  put(data / "transforms.json", all.dump());
}

TEST_CASE("report: the files of a run cannot name places for files, or allow links that lead outside",
          "[cli]") {
  const TempFolder folder;
  test::put_scene(folder / "data", 32, 6, 3);
  distort(folder / "data");
  ubs_ok(folder,
         "train --data data --out run --device cpu --iterations 40 --init-points 150 --cap-max 200 --quiet");
  const std::string report = "report run --device cpu --no-viewer --views 3 --out r.html --overwrite";
  ubs_ok(folder, report);
  REQUIRE(counts(read_page(folder / "r.html"))["truth"] == 3);

  SECTION("a folder for the cache") {
    const std::string none = "planted/.hidden";
    set_in_config(folder / "run", "cache_folder", none);
    ubs_ok(folder, report);
    CHECK(counts(read_page(folder / "r.html"))["truth"] == 3);
    ubs_ok(folder, "eval run --device cpu");
    ubs_ok(folder, "reduce run --device cpu --bound 0.01 --out small.ply --quiet");
    Checkpoint checkpoint = read_checkpoint(folder / "run/continue.ubs");
    checkpoint.settings.cache_folder = none;
    write_checkpoint(folder / "run/checkpoint.ubs", checkpoint);
    CHECK(contains(ubs_ok(folder, "train --resume run --device cpu --quiet").err,
                   "cache_folder = planted/.hidden, which is not used"));
    CHECK_FALSE(fs::exists(folder / "planted"));
    ubs_ok(folder, "eval run --device cpu --cache-folder cache");  // the user may name a folder
    CHECK_FALSE(fs::is_empty(folder / "cache"));
  }
  SECTION("links in the data") {
    fs::create_directories(folder / "secret");
    const fs::path image = fs::directory_iterator(folder / "data/test")->path();
    fs::rename(image, folder / "secret/image.png");
    fs::create_symlink(folder / "secret/image.png", image);
    set_in_config(folder / "run", "allow_outside", "true");
    fs::remove_all(folder / "run/renders");
    CHECK(contains(ubs_ok(folder, report).err, "outside of the folder"));
    CHECK(counts(read_page(folder / "r.html"))["truth"] == 0);
    CHECK(run_ubs(folder, "eval run --device cpu").code == 3);
    CHECK(run_ubs(folder, "reduce run --device cpu --out small.ply").code == 3);
    ubs_ok(folder, report + " --allow-outside");  // the user may allow it
    CHECK(counts(read_page(folder / "r.html"))["truth"] == 3);
    ubs_ok(folder, "eval run --device cpu --allow-outside");
  }
  SECTION("links in the folder of the run") {
    fs::create_directories(folder / "secret");
    for (const char* file : {"metrics.json", "config.yaml", "log.csv", "model.ply", "renders"}) {
      INFO(file);
      fs::rename(folder / "run" / file, folder / "secret" / file);
      fs::create_symlink(folder / "secret" / file, folder / "run" / file);
      CHECK(run_ubs(folder, report).code == 3);
      CHECK(contains(get(folder / "stderr.txt"), "--allow-outside"));
      ubs_ok(folder, report + " --allow-outside");
      fs::remove(folder / "run" / file);
      fs::rename(folder / "secret" / file, folder / "run" / file);
    }
    const fs::path saved = fs::directory_iterator(folder / "run/renders")->path();
    fs::rename(saved, folder / "secret/image.png");
    fs::create_symlink(folder / "secret/image.png", saved);
    CHECK(run_ubs(folder, report).code == 3);
  }
  SECTION("another data set") {
    json metrics = json::parse(get(folder / "run/metrics.json"));
    test::put_scene(folder / "secret", 32, 6, 3, "orbit");
    fs::remove_all(folder / "run/renders");
    metrics["data"] = (folder / "secret").string();
    for (const json& print : {json(), json(-1), json(1e300), json("x"), json(4294967296)}) {
      if (print.is_null())
        metrics.erase("data_print");
      else
        metrics["data_print"] = print;
      put(folder / "run/metrics.json", metrics.dump());
      CHECK(contains(ubs_ok(folder, report).err, "no fingerprint of its data"));
      CHECK(counts(read_page(folder / "r.html"))["truth"] == 0);
      CHECK(run_ubs(folder, "eval run --device cpu").code == 3);
      CHECK(contains(get(folder / "stderr.txt"), "no fingerprint of the data"));
    }
    ubs_ok(folder, report + " --data secret");
    CHECK(counts(read_page(folder / "r.html"))["truth"] == 3);
    // The page does not quote files of a folder that the user has not named.
    metrics["data_print"] = 5;
    put(folder / "run/metrics.json", metrics.dump());
    put(folder / "secret/transforms_train.json", "PRIVATE");
    CHECK(contains(ubs_ok(folder, report).err, "transforms_train.json"));
    CHECK_FALSE(contains(get(folder / "r.html"), "transforms_train.json"));
  }
}

TEST_CASE("report: invalid arguments are rejected", "[cli]") {
  const TempFolder& folder = trained();
  const auto refused = [&](const std::string& arguments, int code, const std::string& message) {
    CHECK(run_ubs(folder, "report " + arguments).code == code);
    CHECK(contains(get(folder / "stderr.txt"), message));
    CHECK_FALSE(fs::exists(folder / "no.html"));
  };
  refused("", 2, "runs");
  refused("nowhere --out no.html", 3, "no such folder");
  refused("nowhere", 3, "no such folder");
  refused("data --out no.html", 3, "not an output folder of 'ubs train'");
  refused("still/log.csv --out no.html", 3, "not a folder");
  refused("still --out data", 2, "is a folder");
  refused("still --views 0", 2, "--views");
  refused("still --out no.html --data nowhere", 3, "nowhere");
  refused("still --out no.html --device nosuch", 4, "nosuch");
  put(folder / "broken/model.ply", "ply\nnonsense");
  refused("broken --out no.html", 3, "model.ply");
}

}  // namespace
}  // namespace ubs
