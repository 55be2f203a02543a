// SPDX-License-Identifier: Apache-2.0
// Tests the shared library as used by a C++ program, through ubs.hpp only. With the same settings, its
// results must be bit-identical to those of the executable.
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <future>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <sstream>
#include <thread>

#include "ubs/ubs.hpp"

namespace {

namespace fs = std::filesystem;

struct Folder {
  Folder() : path(fs::temp_directory_path() / ("ubs-library-" + std::to_string(std::random_device{}()))) {
    fs::create_directories(path);
  }
  ~Folder() {
    std::error_code ignored;
    fs::remove_all(path, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::string operator/(const std::string& name) const { return (path / name).string(); }
  fs::path path;
};

std::string content(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string output_of(const std::string& command) {
  std::string text;
  FILE* pipe = popen(command.c_str(), "r");
  REQUIRE(pipe);
  for (int c; (c = std::fgetc(pipe)) != EOF;) text += static_cast<char>(c);
  INFO(command << "\n" << text);
  REQUIRE(pclose(pipe) == 0);
  return text;
}

void run_ubs(const std::string& arguments) {
  output_of(std::string(UBS_EXECUTABLE) + " " + arguments + " 2>&1");
}

// Returns a folder with a small data set, which the executable creates when this function is called for the
// first time.
const Folder& scene() {
  static const Folder folder;
  static const bool made = [] {
    run_ubs("synth glossy --size 40 --views 8 --test-views 2 --supersampling 1 --out " + (folder / "data"));
    return true;
  }();
  REQUIRE(made);
  return folder;
}

// The settings of all training runs in this file. as_options() and settings() below convert them for the
// executable and for the library.
const std::vector<std::pair<std::string, std::string>> kSettings{
    {"iterations", "60"}, {"init_points", "300"}, {"cap_max", "400"}, {"dim", "6"}, {"log_every", "5"}};

std::string as_options() {
  std::string text;
  for (const auto& [key, value] : kSettings) text += " --set " + key + "=" + value;
  return text;
}

ubs::Settings settings() {
  ubs::Settings made;
  for (const auto& [key, value] : kSettings) made.set(key, value);
  return made;
}

ubs_camera simple_camera(int width = 24, int height = 16) {
  auto camera = ubs::sized<ubs_camera>();
  for (int i = 0; i < 3; ++i) camera.world_to_camera[5 * i] = 1;
  camera.fx = camera.fy = 20;
  camera.cx = width / 2.0;
  camera.cy = height / 2.0;
  camera.width = width;
  camera.height = height;
  return camera;
}

// Returns a model in front of simple_camera(). The seed determines the positions of the splats.
ubs::Model small_model(int dim = 3, unsigned seed = 0, std::size_t splats = 40) {
  ubs::Model model(ubs::Settings().set("dim", dim), splats);
  unsigned state = seed + 1;
  const auto random = [&] {
    state = state * 1664525u + 1013904223u;
    return static_cast<float>(state >> 8) / 16777216.0f;
  };
  for (const ubs::Parameter& p : model.parameters())
    for (float& v : p.values) v = random() - 0.5f;
  for (std::size_t i = 0; i < splats; ++i) model.parameter("xyz").row(2)[i] += 3;
  for (float& v : model.parameter("scale").values) v -= 1.5f;
  return model;
}

template <typename Action>
void check_error(ubs_status status, const std::string& part, const Action& action) {
  try {
    action();
    FAIL("there was no error, but one with '" << part << "' was expected");
  } catch (const ubs::Exception& error) {
    CHECK(error.status() == status);
    INFO(error.what());
    CHECK(std::string(error.what()).find(part) != std::string::npos);
    CHECK(std::string(error.what()).find('\n') == std::string::npos);
  }
}

double norm(std::span<const float> values) {
  double sum = 0;
  for (const float v : values) sum += static_cast<double>(v) * v;
  return std::sqrt(sum);
}

std::vector<float> all_values(const ubs::Model& model) {
  std::vector<float> all;
  for (const ubs::Parameter& p : model.parameters()) all.insert(all.end(), p.values.begin(), p.values.end());
  return all;
}

TEST_CASE("the shared library exports the functions that ubs.h declares, and nothing else") {
  std::set<std::string> shown, declared;
  std::istringstream symbols(output_of("nm -D --defined-only " UBS_LIBRARY));
  for (std::string address, kind, name; symbols >> address >> kind >> name;)
    shown.insert(name.substr(0, name.find('@')));
  const std::string header = content(UBS_SOURCE_DIR "/include/ubs/ubs.h");
  for (std::size_t at = 0; (at = header.find("\nUBS_API ", at)) != std::string::npos; ++at) {
    const std::size_t end = header.find('(', at), start = header.rfind(' ', end) + 1;
    declared.insert(header.substr(start, end - start));
  }
  CHECK(declared.size() <= 62);
  CHECK(declared.size() > 40);
  CHECK(shown == declared);
}

// Returns the environment variables that this process did not start with. tests/main.cpp sets some that start
// with UBS_.
std::set<std::string> added_variables() {
  std::set<std::string> started;
  std::istringstream block(content("/proc/self/environ"));
  for (std::string variable; std::getline(block, variable, '\0');) started.insert(variable);
  std::set<std::string> added;
  for (char** variable = environ; *variable != nullptr; ++variable)
    if (!started.contains(*variable) && std::strncmp(*variable, "UBS_", 4) != 0 &&
        std::strncmp(*variable, "HWLOC_", 6) != 0)  // set by PoCL
      added.insert(*variable);
  return added;
}

TEST_CASE("the library does not change the environment of the process") {
  CHECK(added_variables() == std::set<std::string>{});  // loaded, but not used yet
  ubs::Device device;
  const ubs::Data data(scene() / "data");
  CHECK_FALSE(data.image("train", 0).empty());
  CHECK(added_variables() == std::set<std::string>{});
}

// The run of `ubs train` has config.yaml, the other ones give the settings as JSON or through the library.
// `ubs-lab compare` needs a model, so it gets that of the run.
TEST_CASE("train, plan, compare and the library decide automatic settings in the same way") {
  const Folder& folder = scene();
  const std::string data = folder / "data", run = folder / "decided";
  const std::string asked = " --iterations 30 --seed 7 ";
  run_ubs("train --quiet --data " + data + " --out " + run + asked);
  const auto parsed = [](const std::string& command) { return nlohmann::json::parse(output_of(command)); };
  const nlohmann::json plan = parsed(UBS_EXECUTABLE " plan --json --data " + data + asked + "2>/dev/null"),
                       compared = parsed(UBS_LAB_EXECUTABLE
                                         " compare --json --devices cpu --repeat 1 --seed 7 "
                                         "--train-iterations 30 --model " +
                                         run + " --data " + data + " 2>/dev/null");
  const nlohmann::json trained = nlohmann::json::parse(content(run + "/metrics.json"))["settings"];
  const ubs::Device device;
  const ubs::Data opened(data);
  const ubs::Trainer trainer(device, opened, ubs::Settings().set("iterations", 30).set("seed", 7));
  const ubs::Settings decided = trainer.settings();
  const std::string config = content(run + "/config.yaml");
  std::size_t keys = 0;
  for (const auto& [key, value] : trained.items()) {
    INFO(key);
    CHECK(plan["settings"][key] == value);
    CHECK(compared["devices"][0]["training_settings"][key] == value);
    const std::size_t at = config.find("\n" + key + ": ");
    REQUIRE(at != std::string::npos);
    std::string text = config.substr(at + key.size() + 3, config.find("  # ", at) - at - key.size() - 3);
    std::erase_if(text, [](char c) { return c == '\'' || c == '[' || c == ']' || c == ' '; });
    std::string own = decided.get(key);
    std::erase(own, ' ');
    CHECK(own == text);
    ++keys;
  }
  CHECK(keys > 60);
  CHECK(decided.get("cap_max") == "10000");  // and not the 300 000 of the published schedule
}

TEST_CASE("training with the library gives the same bits as with the executable") {
  const Folder& folder = scene();
  run_ubs("train --quiet --data " + (folder / "data") + " --out " + (folder / "run") + as_options());
  const std::string expected = content(folder / "run/model.ply");
  REQUIRE(expected.size() > 10000);
  ubs::Device device;
  ubs::Data data(folder / "data");
  Folder out;

  ubs::Trainer whole(device, data, settings());
  std::vector<ubs_step> steps;
  whole.run([&](const ubs_step& step) {
    steps.push_back(step);
    return true;
  });
  CHECK(steps.size() == 60);
  CHECK(steps.front().iteration == 1);
  CHECK(steps.back().iterations == 60);
  CHECK(std::isfinite(steps[4].loss));
  CHECK(std::isnan(steps[5].loss));
  CHECK(steps.back().loss < steps[4].loss);
  CHECK(steps.back().test_psnr == whole.evaluate().psnr);
  whole.model().save(out / "whole.ply");
  CHECK(content(out / "whole.ply") == expected);
  CHECK(content(folder / "run/metrics.json").find("\"psnr\"") != std::string::npos);

  // The step function stops training after 17 iterations, five calls run one iteration each, and another
  // trainer continues from a checkpoint.
  ubs::Trainer parts(device, data, settings());
  parts.run([&](const ubs_step& step) { return step.iteration < 17; });
  CHECK(parts.status().iteration == 17);
  for (int i = 0; i < 5; ++i) parts.run({}, 1);
  CHECK(parts.status().iteration == 22);
  parts.save(out / "checkpoint.ubs");
  ubs::Trainer again(device, data, settings());
  again.restore(out / "checkpoint.ubs");
  CHECK(again.status().iteration == 22);
  again.run();
  again.model().save(out / "parts.ply");
  CHECK(content(out / "parts.ply") == expected);

  // Trains from an initial model that is passed to the trainer, and from the one that the trainer creates.
  // With unit = 1, which does not scale the data, the results are bit-identical.
  const ubs::Settings in_unit = settings().set("unit", "1");
  const ubs::Model initial = ubs::Model::initial(data, in_unit);
  ubs::Trainer given(device, data, in_unit, &initial), own(device, data, in_unit);
  given.run();
  own.run();
  given.model().save(out / "given.ply");
  own.model().save(out / "own.ply");
  CHECK(content(out / "given.ply") == content(out / "own.ply"));

  check_error(UBS_ERROR_USAGE, "lambda_dssim", [&] {
    ubs::Trainer(device, data, settings().set("lambda_dssim", "0.3")).restore(out / "checkpoint.ubs");
  });
  check_error(UBS_ERROR_DATA, "no such file", [&] { again.restore(out / "nothing.ubs"); });
  const ubs::Model larger = small_model(6, 0, 500);
  ubs::Trainer(device, data, settings(), &larger).save(out / "larger.ubs");
  check_error(UBS_ERROR_USAGE, "memory for 400", [&] { again.restore(out / "larger.ubs"); });
}

TEST_CASE(
    "data from arrays and from a folder give the same model; images and gradients equal those of the "
    "executable") {
  const Folder& folder = scene();
  const ubs::Data opened(folder / "data");
  ubs::Data made;
  for (const std::string split : {"train", "test"})
    for (std::size_t i = 0; i < opened.view_count(split); ++i) {
      const ubs_view view = opened.view(split, i);
      CHECK(view.has_image == 1);
      made.add_view(split, view.name, view.camera, opened.image(split, i));
    }
  CHECK(made.view_count("train") == 8);
  CHECK(made.view_count("val") == 0);
  CHECK(made.image("test", 1) == opened.image("test", 1));
  ubs::Device device;
  // The images of the folder have an alpha channel, and those of the arrays do not. So both runs use a
  // constant black background, for which this makes no difference.
  const auto first =
      settings().set("iterations", 20).set("background", "black").set("random_background", "off");
  ubs::Trainer a(device, opened, first), b(device, made, first);
  a.run();
  b.run();
  const ubs::Model model = a.model();
  CHECK(all_values(model) == all_values(b.model()));

  Folder out;
  model.save(out / "model.ply");
  const std::string common = " --model " + (out / "model.ply") + " --data " + (folder / "data");
  run_ubs("render --format npy --channels rgb,alpha,depth --views 1 --out " + (out / "views") + common);
  ubs::Renderer renderer(device, model, UBS_RENDER_DEPTH | UBS_RENDER_GRADIENTS);
  const ubs_view view = opened.view("test", 1);
  const ubs::Picture picture = renderer.draw(view.camera);
  for (const auto& [suffix, values] : {std::pair<std::string, const std::vector<float>&>{"", picture.rgb},
                                       {"_alpha", picture.alpha},
                                       {"_depth", picture.depth}}) {
    const std::string npy = content(out / ("views/" + std::string(view.name) + suffix + ".npy"));
    const std::size_t bytes = values.size() * sizeof(float);
    REQUIRE(npy.size() > bytes);
    CHECK(std::memcmp(npy.data() + npy.size() - bytes, values.data(), bytes) == 0);
    CHECK(norm(values) > 0);
  }

  output_of(UBS_LAB_EXECUTABLE +
            (" gradients --view 1 --set query_grad=true --out " + (out / "gradient.ply") + common + " 2>&1"));
  std::vector<float> target;
  for (const std::uint8_t v : opened.image("test", 1)) target.push_back(static_cast<float>(v) / 255.0f);
  const ubs::Model gradient(model);
  const ubs_loss loss = renderer.loss(view.camera, target, 0.2f, &gradient);
  CHECK(loss.loss == Approx(0.8 * loss.l1 + 0.2 * (1 - loss.ssim)).epsilon(1e-6));
  CHECK(renderer.loss(view.camera, target, 0.2f).loss == loss.loss);
  CHECK(norm(all_values(gradient)) > 0);
  CHECK(all_values(gradient) == all_values(ubs::Model(out / "gradient.ply")));

  // With lambda = 0, the loss is the mean absolute difference. Computes its gradient from the rendered image
  // with vjp(), and compares the result with that of loss().
  std::vector<float> v(target.size());
  for (std::size_t i = 0; i < v.size(); ++i)
    v[i] = (picture.rgb[i] > target[i] ? 1.0f : -1.0f) / static_cast<float>(v.size());
  const ubs::Model by_hand(model);
  renderer.vjp(view.camera, v, {}, by_hand);
  renderer.loss(view.camera, target, 0.0f, &gradient);
  const std::vector<float> x = all_values(gradient), y = all_values(by_hand);
  std::vector<float> difference;
  for (std::size_t i = 0; i < x.size(); ++i) difference.push_back(x[i] - y[i]);
  CHECK(norm(difference) <= 1e-5 * norm(x));
}

TEST_CASE("files preserve the values of models, pointers to values stay valid, and NaN is not saved") {
  Folder out;
  const ubs::Model model = small_model(7);
  CHECK(model.info().dim == 7);
  CHECK(model.info().splats == 40);
  CHECK(model.info().parameters == 40 * (7 * 8 / 2 + 2 * 7 + 2));
  model.save(out / "model.ply");
  const ubs::Model loaded(out / "model.ply");
  CHECK(all_values(loaded) == all_values(model));
  CHECK(loaded.settings().get("dim") == "7");
  small_model(3).save(out / "model.spz", "spz");
  const ubs::Model gaussians(out / "model.spz");
  CHECK(gaussians.info().dim == 3);
  CHECK(std::string(gaussians.info().form).find("gaussian") != std::string::npos);
  CHECK(gaussians.parameter("rotation").rows == 4);

  ubs::Device device;
  ubs::Renderer renderer(device, model, UBS_RENDER_GRADIENTS);
  const ubs::Model gradient(model);
  const std::span<float> xyz = gradient.parameter("xyz").values;
  const std::vector<float> before(xyz.begin(), xyz.end());
  renderer.vjp(simple_camera(), std::vector<float>(3 * 24 * 16, 1.0f), {}, gradient);
  CHECK(xyz.data() == gradient.parameter("xyz").values.data());
  CHECK(!std::equal(xyz.begin(), xyz.end(), before.begin()));

  model.parameter("xyz").values[0] = std::numeric_limits<float>::quiet_NaN();
  check_error(UBS_ERROR_NUMERICAL, "", [&] { model.save(out / "other.ply"); });
  CHECK(!fs::exists(out / "other.ply"));
  std::ofstream(out / "older.ply") << "an older file";
  loaded.save(out / "older.ply");
  CHECK(all_values(ubs::Model(out / "older.ply")) == all_values(loaded));
  fs::create_symlink("older.ply", fs::path(out / "link.ply"));
  check_error(UBS_ERROR_DATA, "link.ply: this is a symbolic link", [&] { loaded.save(out / "link.ply"); });
  check_error(UBS_ERROR_USAGE, "unknown output format", [&] { loaded.save(out / "x.ply", "obj"); });
  check_error(UBS_ERROR_USAGE, "time = nan",
              [&] { loaded.save(out / "x.ply", "3dgs", std::numeric_limits<double>::quiet_NaN()); });
}

TEST_CASE("two threads with one renderer each get correct images, on two devices or on a shared one") {
  const ubs::Model models[2] = {small_model(3, 1), small_model(6, 2)};
  std::vector<float> expected[2], found[2][8];
  for (int k = 0; k < 2; ++k) {
    ubs::Device device;
    expected[k] = ubs::Renderer(device, models[k]).draw(simple_camera()).rgb;
    CHECK(norm(expected[k]) > 0);
  }
  ubs::Device devices[2];
  ubs::Renderer renderers[2] = {ubs::Renderer(devices[0], models[0]), ubs::Renderer(devices[1], models[1])};
  std::string messages[2];
  const auto work = [&](int k, ubs::Renderer& renderer) {
    for (auto& picture : found[k]) picture = renderer.draw(simple_camera()).rgb;
    try {
      ubs::Settings().set("dim", k == 0 ? "99" : "text");
    } catch (const ubs::Exception& error) {
      messages[k] = error.what();
    }
  };
  std::thread first(work, 0, std::ref(renderers[0])), second(work, 1, std::ref(renderers[1]));
  first.join();
  second.join();
  for (int k = 0; k < 2; ++k)
    for (const auto& picture : found[k]) CHECK(picture == expected[k]);
  CHECK(messages[0].find("99") != std::string::npos);
  CHECK(messages[1].find("text") != std::string::npos);

  // Threads that share a device wait for one another.
  ubs::Renderer shared[2] = {ubs::Renderer(devices[0], models[0]), ubs::Renderer(devices[0], models[1])};
  std::thread third(work, 0, std::ref(shared[0])), fourth(work, 1, std::ref(shared[1]));
  third.join();
  fourth.join();
  for (int k = 0; k < 2; ++k)
    for (const auto& picture : found[k]) CHECK(picture == expected[k]);
}

TEST_CASE("several threads train at the same time, each with its own device, and get the same bits") {
  const std::string data = scene() / "data";
  const auto trained = [&] {
    const ubs::Device device;
    ubs::Trainer trainer(device, ubs::Data(data), settings());
    trainer.run({}, 10);
    return all_values(trainer.model());
  };
  std::vector<std::future<std::vector<float>>> others;
  for (int k = 0; k < 3; ++k) others.push_back(std::async(std::launch::async, trained));
  const std::vector<float> alone = trained();
  CHECK(norm(alone) > 0);
  for (auto& other : others) CHECK(other.get() == alone);
}

// Compares the gradient of a weighted sum of colours and depths with central differences of renders. These
// differences have only about two correct digits, because renders have single precision and splats end
// abruptly at their rims. tests/pipeline compares gradients with those in float64.
TEST_CASE("the camera gradient of colours and depth agrees with central differences of renders") {
  ubs::Device device;
  const ubs::Model model = small_model(6);
  for (float& v : model.parameter("opacity").values) v += 2;
  ubs::Renderer renderer(device, model, UBS_RENDER_GRADIENTS | UBS_RENDER_DEPTH);
  check_error(UBS_ERROR_USAGE, "no gradient yet", [&] { renderer.camera_gradient(); });
  const ubs_camera camera = simple_camera();
  const std::size_t pixels = 24 * 16;
  std::vector<float> v_rgb(3 * pixels), v_depth(pixels);
  for (std::size_t i = 0; i < v_rgb.size(); ++i) v_rgb[i] = std::sin(0.02f * static_cast<float>(i));
  const ubs::Picture before = renderer.draw(camera);
  for (std::size_t i = 0; i < pixels; ++i)  // only pixels that splats cover: depth is discontinuous elsewhere
    v_depth[i] = before.alpha[i] > 0.1f ? 0.3f : 0.0f;
  renderer.vjp(camera, v_rgb, {}, nullptr, v_depth);
  check_error(UBS_ERROR_USAGE, "render it again", [&] { renderer.array(UBS_ARRAY_RGB); });
  const ubs_camera_gradient found = renderer.camera_gradient();
  const auto number = [&](const ubs_camera& seen) {
    const ubs::Picture picture = renderer.draw(seen);
    double sum = 0;
    for (std::size_t i = 0; i < v_rgb.size(); ++i) sum += static_cast<double>(v_rgb[i]) * picture.rgb[i];
    for (std::size_t i = 0; i < pixels; ++i) sum += static_cast<double>(v_depth[i]) * picture.depth[i];
    return sum;
  };
  const auto difference = [&](double h, const auto& move) {
    ubs_camera a = camera, b = camera;
    move(a, h);
    move(b, -h);
    return (number(a) - number(b)) / (2 * h);
  };
  for (int k = 0; k < 3; ++k) {
    const int a = (k + 1) % 3, b = (k + 2) % 3;
    const double turned = difference(2e-3, [&](ubs_camera& c, double h) {
      for (int i = 0; i < 4; ++i) {
        const double x = c.world_to_camera[4 * a + i], y = c.world_to_camera[4 * b + i];
        c.world_to_camera[4 * a + i] = std::cos(h) * x - std::sin(h) * y;
        c.world_to_camera[4 * b + i] = std::sin(h) * x + std::cos(h) * y;
      }
    });
    const double shifted =
        difference(2e-3, [&](ubs_camera& c, double h) { c.world_to_camera[4 * k + 3] += h; });
    INFO(k << ": " << turned << ", " << shifted);
    CHECK(found.pose[k] == Approx(turned).epsilon(0.05).margin(0.5));
    CHECK(found.pose[3 + k] == Approx(shifted).epsilon(0.05).margin(0.5));
    CHECK(found.world_to_camera[4 * k + 3] == found.pose[3 + k]);
  }
  CHECK(found.fx ==
        Approx(difference(0.05, [](ubs_camera& c, double h) { c.fx += h; })).epsilon(0.05).margin(0.05));
  CHECK(found.cy ==
        Approx(difference(0.05, [](ubs_camera& c, double h) { c.cy += h; })).epsilon(0.05).margin(0.05));
  renderer.draw(camera);
  check_error(UBS_ERROR_USAGE, "no gradient yet", [&] { renderer.camera_gradient(); });

  std::string sky = "0.5,0.5,0.5,0.1";
  for (int i = 1; i < 24; ++i) sky += ",0";
  ubs::Renderer before_sky(device, model, model.settings().set("background", sky), UBS_RENDER_GRADIENTS);
  before_sky.vjp(camera, v_rgb, {}, nullptr);
  check_error(UBS_ERROR_USAGE, "sky", [&] { before_sky.camera_gradient(); });

  // Simulates a program that was compiled before ubs_image_gradient had the member `depth`.
  auto v = ubs::sized<ubs_image_gradient>();
  v.size = offsetof(ubs_image_gradient, depth);
  v.rgb = v_rgb.data();
  v.depth = v_depth.data();
  const ubs::Model old(model), now(model);
  ubs::check(ubs_renderer_vjp(renderer.get(), &camera, &v, old.get()));
  renderer.vjp(camera, v_rgb, {}, now);
  CHECK(all_values(old) == all_values(now));
}

TEST_CASE("further channels need absolute gradients and all of their arrays") {
  ubs::Device device;
  const ubs::Model model = small_model();
  const ubs_camera camera = simple_camera();
  constexpr std::size_t kPixels = std::size_t{24} * 16;
  const std::vector<float> v_rgb(3 * kPixels, 1.0f), zeros(2 * kPixels), colours(std::size_t{2} * 40, 0.5f);
  std::vector<float> damaged = colours;
  damaged.back() = NAN;
  const auto refused = [&](unsigned flags, const float* of_splats, const char* word) {
    auto v = ubs::sized<ubs_image_gradient>();
    v.rgb = v_rgb.data();
    v.more_channels = 2;
    v.more = v.more_image = zeros.data();
    v.more_colours = of_splats;
    const ubs::Renderer renderer(device, model, flags);
    const ubs::Model gradient(model);
    check_error(UBS_ERROR_USAGE, word,
                [&] { ubs::check(ubs_renderer_vjp(renderer.get(), &camera, &v, gradient.get())); });
  };
  refused(UBS_RENDER_GRADIENTS, colours.data(), "requires UBS_RENDER_ABSGRAD");
  refused(UBS_RENDER_GRADIENTS | UBS_RENDER_ABSGRAD, nullptr, "more_colours is NULL");
  refused(UBS_RENDER_GRADIENTS | UBS_RENDER_ABSGRAD, damaged.data(), "v_image.more_colours");
}

TEST_CASE("creating and freeing objects leaves no memory allocated on the device") {
  ubs::Device device;
  const ubs::Model model = small_model();
  const auto once = [&] {
    ubs::Renderer renderer(device, model, UBS_RENDER_GRADIENTS);
    renderer.draw(simple_camera());
    renderer.vjp(simple_camera(), std::vector<float>(3 * 24 * 16, 1.0f), {}, ubs::Model(model));
    ubs::Meter(device).compare(24, 16, std::vector<float>(3 * 24 * 16), std::vector<float>(3 * 24 * 16));
  };
  once();
  const std::uint64_t before = device.info().allocated_bytes;
  for (int i = 0; i < 10; ++i) once();
  CHECK(device.info().allocated_bytes == before);
  CHECK(device.info().peak_bytes > before);
  const ubs::Data data(scene() / "data");
  for (int i = 0; i < 3; ++i) ubs::Trainer(device, data, settings()).run({}, 2);
  CHECK(device.info().allocated_bytes == before);
}

// Returns the resident memory of the process [bytes], without pages of mapped files.
std::uint64_t resident_bytes() {
  std::ifstream status("/proc/self/status");
  for (std::string word; status >> word;) {
    std::uint64_t kib = 0;
    if (word == "RssAnon:" && status >> kib) return kib << 10;
  }
  FAIL("/proc/self/status has no line RssAnon");
  return 0;
}

TEST_CASE("opening and closing models and settings a thousand times does not increase the memory") {
  Folder out;
  small_model(6, 1, 1000).save(out / "model.ply");
  small_model(3, 1, 1000).save(out / "model.spz", "spz");
  std::ofstream(out / "bad.ply") << content(out / "model.ply").substr(0, 20000);
  const auto once = [&] {
    for (const char* name : {"model.ply", "model.spz"})
      CHECK(ubs::Model(ubs::Model(out / name)).info().splats == 1000);
    CHECK(settings().get("dim") == "6");
    check_error(UBS_ERROR_DATA, "bad.ply", [&] { ubs::Model(out / "bad.ply"); });
    check_error(UBS_ERROR_DATA, "nowhere", [&] { ubs::Data(out / "nowhere"); });
  };
  constexpr int kRounds = 1000;
  for (int i = 0; i < 100; ++i) once();  // the first rounds allocate memory that later ones use again
  const std::uint64_t before = resident_bytes();
  for (int i = 0; i < kRounds; ++i) once();
  const auto grown = static_cast<double>(resident_bytes()) - static_cast<double>(before);
  CHECK(grown < 100.0 * kRounds);  // the growth observed is 12 KiB
  // Also opens data sets, but does not check the growth of memory. Threads decode the images of a data set,
  // and the allocator keeps some of their memory: the usual allocator keeps 16 bytes for each data set, and
  // that of LeakSanitizer 12 KiB. If memory leaks here, LeakSanitizer makes the test fail.
  for (int i = 0; i < kRounds; ++i) CHECK(!ubs::Data(scene() / "data").image("train", 0).empty());
}

TEST_CASE("a renderer accepts a new model with at most as many splats and the same dimensions") {
  ubs::Device device;
  const ubs::Model one = small_model(6, 1), other = small_model(6, 5), fewer = small_model(6, 5, 10),
                   more = small_model(6, 5, 41);
  ubs::Renderer renderer(device, one);
  const auto of_one = renderer.draw(simple_camera()).rgb;
  renderer.update(other);
  const auto of_other = renderer.draw(simple_camera()).rgb;
  CHECK(of_one != of_other);
  CHECK(of_other == ubs::Renderer(device, other).draw(simple_camera()).rgb);
  renderer.update(fewer);
  CHECK(renderer.draw(simple_camera()).rgb == ubs::Renderer(device, fewer).draw(simple_camera()).rgb);
  renderer.update(one);
  CHECK(renderer.draw(simple_camera()).rgb == of_one);
  check_error(UBS_ERROR_USAGE, "does not match", [&] { renderer.update(more); });
  check_error(UBS_ERROR_USAGE, "does not match", [&] { renderer.update(small_model(3)); });
}

TEST_CASE("a step function may read and evaluate the trainer, stop training and throw") {
  ubs::Device device;
  const ubs::Data data(scene() / "data");
  ubs::Trainer trainer(device, data, settings());
  trainer.run([&](const ubs_step& step) {
    CHECK(trainer.status().iteration == step.iteration);
    CHECK(trainer.model().info().splats == step.splats);
    CHECK(trainer.evaluate().psnr > 0);
    check_error(UBS_ERROR_USAGE, "step callback", [&] { trainer.run(); });
    return step.iteration < 2;
  });
  CHECK(trainer.status().iteration == 2);
  CHECK_THROWS_AS(trainer.run([](const ubs_step&) -> bool { throw std::domain_error("mine"); }),
                  std::domain_error);
  CHECK(trainer.status().iteration == 3);
}

TEST_CASE("each test view is measured, and the status has the last loss") {
  ubs::Device device;
  const ubs::Data data(scene() / "data");
  ubs::Trainer trainer(device, data, settings());
  CHECK(std::isnan(trainer.status().loss));
  double loss = 0;
  trainer.run([&](const ubs_step& step) {
    loss = step.loss;
    return std::isnan(loss);
  });
  CHECK(trainer.status().loss == loss);
  const std::size_t count = data.view_count("test");
  REQUIRE(count == 2);
  ubs::Meter meter(device);
  const std::vector<ubs_metrics> views = trainer.evaluate_views(count, &meter);
  CHECK((views[0].psnr + views[1].psnr) / 2 == Approx(trainer.evaluate().psnr));
  CHECK(views[0].psnr != views[1].psnr);
  CHECK(views[1].ssim_valid > 0);
  CHECK(std::isnan(trainer.evaluate_views(count)[1].ssim_valid));
  check_error(UBS_ERROR_USAGE, "count is 3, but there are 2", [&] { trainer.evaluate_views(3); });
  ubs::Device other;
  ubs::Meter elsewhere(other);
  check_error(UBS_ERROR_USAGE, "different devices", [&] { trainer.evaluate_views(count, &elsewhere); });
}

TEST_CASE("a call that creates an object ends when it is asked to stop") {
  std::int32_t stop = 1;
  ubs_set_stop_flag(&stop);
  check_error(UBS_STOPPED, "stopped by the caller", [&] { ubs::Data(scene() / "data"); });
  stop = 0;
  CHECK(ubs::Data(scene() / "data").view_count("train") > 0);
  ubs_set_stop_flag(nullptr);
}

TEST_CASE("errors describe the problem") {
  ubs::Device device;
  const ubs::Model model = small_model();
  ubs::Renderer renderer(device, model);
  const std::vector<float> pixels(3 * 24 * 16, 0.5f);

  ubs::Settings some;
  check_error(UBS_ERROR_USAGE, "did you mean", [&] { some.set("iteration", 5); });
  check_error(UBS_ERROR_USAGE, "dim", [&] { some.set("dim", 12); });
  check_error(UBS_ERROR_USAGE, "unknown key 'size'", [&] { some.get("size"); });
  check_error(UBS_ERROR_DATA, "no-such.yaml", [&] { some.load("no-such.yaml"); });
  check_error(UBS_ERROR_DATA, "no-such-folder", [&] { ubs::Data("no-such-folder"); });
  check_error(UBS_ERROR_DATA, "no-such.ply", [&] { ubs::Model("no-such.ply"); });
  check_error(UBS_ERROR_USAGE, "dim = auto", [&] { ubs::Model(ubs::Settings().set("dim", "auto"), 5); });
  check_error(UBS_ERROR_USAGE, "splats", [&] { ubs::Model(ubs::Settings().set("dim", 6), 0); });
  check_error(UBS_ERROR_USAGE, "group 1 does not exist", [&] { model.parameters(1); });
  check_error(UBS_ERROR_DEVICE, "matches no device", [&] { ubs::Device("quantum"); });

  auto camera = simple_camera();
  camera.world_to_camera[0] = 2;
  check_error(UBS_ERROR_DATA, "not a rotation", [&] { renderer.draw(camera); });
  camera = simple_camera();
  camera.fx = 0;
  check_error(UBS_ERROR_DATA, "focal length", [&] { renderer.draw(camera); });
  camera = simple_camera();
  camera.width = camera.height = 2000000000;  // larger than any possible vector
  check_error(UBS_ERROR_DATA, "is not possible", [&] { renderer.draw(camera); });
  ubs::Meter meter(device);
  auto metrics = ubs::sized<ubs_metrics>();
  for (const int side : {0, -1, 70000, 2000000000})  // refused before the images are read
    check_error(UBS_ERROR_USAGE, "is not possible", [&] {
      ubs::check(ubs_meter_compare(meter.get(), side, side, pixels.data(), pixels.data(), &metrics));
    });
  camera = simple_camera();
  camera.extra_count = 5;
  check_error(UBS_ERROR_USAGE, "query values", [&] { renderer.draw(camera); });
  check_error(UBS_ERROR_USAGE, "`extra` of the camera has 0 values",
              [&] { ubs::Renderer(device, small_model(8)).draw(simple_camera()); });
  check_error(UBS_ERROR_USAGE, "UBS_RENDER_GRADIENTS",
              [&] { renderer.vjp(simple_camera(), pixels, {}, ubs::Model(model)); });
  check_error(UBS_ERROR_USAGE, "flags", [&] { ubs::Renderer(device, model, 16u); });
  check_error(UBS_ERROR_USAGE, "far_plane = 0.001",
              [&] { ubs::Renderer(device, model, model.settings().set("far_plane", "0.001")); });
  ubs::Renderer with_gradients(device, model, UBS_RENDER_GRADIENTS);
  check_error(UBS_ERROR_USAGE, "does not match",
              [&] { with_gradients.vjp(simple_camera(), pixels, {}, small_model(3, 0, 7)); });
  auto broken = pixels;
  broken[5] = std::numeric_limits<float>::infinity();
  check_error(UBS_ERROR_USAGE, "not finite",
              [&] { with_gradients.vjp(simple_camera(), broken, {}, ubs::Model(model)); });
  check_error(UBS_ERROR_USAGE, "target", [&] { with_gradients.loss(simple_camera(), broken, 0.2f); });
  check_error(UBS_ERROR_USAGE, "lambda", [&] { with_gradients.loss(simple_camera(), pixels, 1.5f); });
  check_error(UBS_ERROR_USAGE, "leaves no pixel", [&] {
    with_gradients.loss(simple_camera(), pixels, 0.2f, nullptr, std::vector<std::uint8_t>(24 * 16));
  });
  check_error(UBS_ERROR_NUMERICAL, "not finite", [&] { ubs::Meter(device).compare(24, 16, pixels, broken); });
  check_error(UBS_ERROR_USAGE, "UBS_LPIPS_WEIGHTS", [&] { ubs::Meter(device, "alex"); });
  check_error(UBS_ERROR_USAGE, "network", [&] { ubs::Meter(device, "resnet", "/nowhere"); });

  ubs::Data data;
  const std::vector<std::uint8_t> image(3 * 24 * 16);
  check_error(UBS_ERROR_DATA, "split 'train' has no views", [&] { ubs::Trainer(device, data, settings()); });
  check_error(UBS_ERROR_USAGE, "split", [&] { data.add_view("training", "", simple_camera(), image); });
  check_error(UBS_ERROR_USAGE, "not a valid view name",
              [&] { data.add_view("train", "a/b", simple_camera(), image); });
  // A rejected view does not create a split.
  check_error(UBS_ERROR_USAGE, "not a valid view name",
              [&] { data.add_view("val", "a/b", simple_camera(), image); });
  check_error(UBS_ERROR_USAGE, "no split 'val'", [&] { data.image("val", 0); });
  data.add_view("train", "", simple_camera());
  check_error(UBS_ERROR_USAGE, "already", [&] { data.add_view("train", "0", simple_camera(), image); });
  check_error(UBS_ERROR_DATA, "no image", [&] { ubs::Trainer(device, data, settings()); });
  check_error(UBS_ERROR_DATA, "no image", [&] { data.image("train", 0); });
  check_error(UBS_ERROR_USAGE, "view 3 does not exist", [&] { data.view("train", 3); });
  check_error(UBS_ERROR_DATA, "points", [&] {
    data.set_points(std::vector<float>{0, 1, std::numeric_limits<float>::quiet_NaN()});
  });
  check_error(UBS_ERROR_USAGE, "the positions: expected 3 values, not 4", [&] {
    data.set_points(std::vector<float>{0, 1, 2, 3});
  });

  ubs::Data full;
  full.add_view("train", "", simple_camera(), image);
  check_error(UBS_ERROR_DATA, "no test views", [&] { ubs::Trainer(device, full, settings()).evaluate(); });
  const ubs::Model wrong = small_model(3);
  check_error(UBS_ERROR_USAGE, "3 dimensions", [&] { ubs::Trainer(device, full, settings(), &wrong); });
  const ubs::Model other_form = small_model(6);  // has the default variant, the settings have another one
  check_error(UBS_ERROR_USAGE, "has the variant 'default', but the settings have 'colour sh3'",
              [&] { ubs::Trainer(device, full, settings().set("colour", "sh3"), &other_form); });
  ubs::Trainer trainer(device, full, settings());
  check_error(UBS_ERROR_USAGE, "cannot be changed",
              [&] { full.add_view("test", "", simple_camera(), image); });

  CHECK(ubs_settings_set(nullptr, "dim", "3") == UBS_ERROR_USAGE);
  CHECK(ubs_settings_set(some.get(), nullptr, "3") == UBS_ERROR_USAGE);
  CHECK(ubs_model_load("x", nullptr) == UBS_ERROR_USAGE);
  ubs_model* none = reinterpret_cast<ubs_model*>(1);
  CHECK(ubs_model_load("no-such.ply", &none) == UBS_ERROR_DATA);
  CHECK(none == nullptr);
}

TEST_CASE(
    "settings without effect are rejected, scenes are created, and the splats of a trainer can be replaced") {
  const ubs::Settings set = ubs::Settings().set("background", "1,1,1").set("eps2d", "0.5");
  set.check_effect(UBS_USE_RENDERER);
  set.check_effect(UBS_USE_MODEL);
  check_error(UBS_ERROR_USAGE, "eps2d has no effect on data", [&] { set.check_effect(UBS_USE_DATA); });
  check_error(UBS_ERROR_USAGE, "checkpoint_every has no effect on a trainer",
              [&] { ubs::Settings().set("checkpoint_every", "9").check_effect(UBS_USE_TRAINER); });
  const Folder out;
  ubs::Data::synthesise({.scene = "glossy", .width = 20, .height = 16, .train_views = 5, .test_views = -1},
                        out / "scene");
  const ubs::Data data(out / "scene");
  CHECK(data.view_count("train") == 5);
  CHECK(data.view_count("test") == 0);
  CHECK(data.view("train", 4).camera.height == 16);
  check_error(UBS_ERROR_USAGE, "scene.scene is NULL", [&] { ubs::Data::synthesise({}, out / "none"); });
  check_error(UBS_ERROR_USAGE, "pass overwrite",
              [&] { ubs::Data::synthesise({.scene = "orbit"}, out / "scene"); });
  ubs::Device device;
  ubs::Trainer trainer(device, data, settings());
  trainer.run({}, 10);
  const ubs::Model before = trainer.model();
  const std::size_t splats = before.parameter("xyz").splats;
  ubs::Model half = before.like(splats / 2);
  std::vector<std::int64_t> from;
  for (std::size_t i = 0; i < splats / 2; ++i) from.push_back(static_cast<std::int64_t>(2 * i));
  for (const ubs::Parameter& p : half.parameters())
    for (std::size_t r = 0; r < p.rows; ++r)
      for (std::size_t i = 0; i < p.splats; ++i) p.row(r)[i] = before.parameter(p.name).row(r)[2 * i];
  trainer.set_model(half, from);
  CHECK(trainer.status().iteration == 10);
  CHECK(trainer.status().splats == splats / 2);
  trainer.run({}, 5);
  from[3] = static_cast<std::int64_t>(splats);
  check_error(UBS_ERROR_USAGE, "from[3] = ", [&] { trainer.set_model(half, from); });
  check_error(UBS_ERROR_USAGE, "memory for 400", [&] { trainer.set_model(before.like(401)); });
  check_error(UBS_ERROR_USAGE, "1 to 100000000 splats", [&] { before.like(0); });
}

TEST_CASE("every setting has a help text, can be read, and can be set to the value that was read") {
  ubs::Settings settings;
  std::size_t count = 0;
  for (;; ++count) {
    const char *key = nullptr, *help = nullptr;
    REQUIRE(ubs_settings_describe(count, &key, &help) == UBS_OK);
    if (!key) break;
    CHECK(std::strlen(help) > 0);
    settings.set(key, settings.get(key));
  }
  CHECK(count > 50);
}

}  // namespace

// Required by tests/main.cpp. It does nothing, because the library selects the device itself.
namespace ubs::test {
int use_device(const std::string&, bool, bool) { return 0; }
}  // namespace ubs::test

// Writes a data set with one training image that OpenCV decodes.
void put_bitmaps(const fs::path& folder) {
  fs::create_directories(folder);
  std::ofstream(folder / "transforms_train.json")
      << R"({"camera_angle_x": 0.8, "frames": [{"file_path": "a.bmp", "transform_matrix":
            [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}]})";
  std::string bytes("BM\x36\x03\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\x10\0\0\0\x10\0\0\0\1\0\x18", 29);
  bytes.resize(54);  // header of an image of 16 x 16 pixels with 24 bits each
  for (int i = 0; i < 3 * 16 * 16; ++i) bytes += static_cast<char>(i);
  std::ofstream(folder / "a.bmp", std::ios::binary) << bytes;
}

// Before the mutex in host/device/registry.cpp, 21 of 26 first uses by several threads crashed.
TEST_CASE("six threads can use the library for the first time at once, with any function") {
  const Folder& folder = scene();
  put_bitmaps(folder.path / "bitmaps");
  small_model().save(folder / "model.ply");
  {
    std::ofstream yaml(folder / "settings.yaml");
    for (const auto& [key, value] : kSettings) yaml << key << ": " << value << "\n";
  }
  for (const char* action : {"library", "devices", "open", "render", "train", "compare", "settings",
                             "synthesise", "arrays", "data", "bitmaps", "convert", "mixed"})
    for (int run = 0; run < 3; ++run)
      output_of(std::string(UBS_FIRST_USE " ") + action + " '" + folder.path.string() + "' 2>&1");
  // The threads also compare the device with float64 at once, and keep the result in an empty cache.
  const std::string checked = "UBS_CHECK=on UBS_KERNEL_CACHE='" + folder.path.string() + "/cache' ";
  output_of(checked + UBS_FIRST_USE " compare '" + folder.path.string() + "' 2>&1");
}
