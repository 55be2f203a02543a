// SPDX-License-Identifier: Apache-2.0
// A program that uses the library for the first time from six threads at once, as library_test.cpp calls it:
//   first_use ACTION FOLDER
// The threads wait for one another, and then all of them take the same action, or each takes another one if
// ACTION is "mixed". FOLDER has the data sets `data` and `bitmaps`, the model `model.ply` and the settings
// `settings.yaml`. The exit code is 1 if an action fails, or if two threads get different results. Each run
// is a new process, because only the first use creates the state that the threads share: drivers, modules,
// tables and caches.
#include <unistd.h>

#include <array>
#include <barrier>
#include <cstdio>
#include <functional>
#include <thread>
#include <utility>

#include "ubs/ubs.hpp"

namespace {

constexpr std::size_t kThreads = 6;

struct Place {
  std::string folder;
  std::size_t thread;
  std::string operator/(const std::string& name) const { return folder + "/" + name; }
  // Returns a path that neither another thread nor another process uses.
  std::string own(const std::string& name) const {
    return folder + "/" + std::to_string(::getpid()) + "-" + std::to_string(thread) + "-" + name;
  }
};

using Values = std::vector<float>;  // the result of an action

ubs_camera front_camera() {
  auto camera = ubs::sized<ubs_camera>();
  for (int i = 0; i < 3; ++i) camera.world_to_camera[5 * i] = 1;
  camera.world_to_camera[11] = 4;
  camera.fx = camera.fy = 20;
  camera.cx = camera.cy = 12;
  camera.width = camera.height = 24;
  return camera;
}

Values values_of(const ubs::Model& model) {
  Values all;
  for (const ubs::Parameter& p : model.parameters()) all.insert(all.end(), p.values.begin(), p.values.end());
  return all;
}

Values pixels_of(const ubs::Data& data) {
  const std::vector<std::uint8_t> bytes = data.image("train", 0);
  return {bytes.begin(), bytes.end()};
}

Values call_library(const Place&) {
  ubs_set_log([](void*, int, const char*) {}, nullptr);
  size_t count = 0;
  const bool named = *ubs_version() != 0 && *ubs_error_message() == 0;
  const bool failed = ubs_device_count(nullptr) == UBS_ERROR_USAGE && *ubs_error_message() != 0;
  ubs::check(ubs_device_count(&count));
  return {static_cast<float>(ubs_abi_version()), named ? 1.f : 0.f, failed ? 1.f : 0.f,
          static_cast<float>(count)};
}

Values list_devices(const Place&) {
  Values text;
  for (const ubs_device_info& info : ubs::Device::list())
    for (const char* field : {info.backend, info.platform, info.vendor, info.name, info.driver})
      for (; *field; ++field) text.push_back(static_cast<float>(*field));
  if (text.empty()) throw std::runtime_error("no device is listed");
  return text;
}

Values open_device(const Place&) {
  const ubs::Device device;
  return {static_cast<float>(device.info().compute_units)};
}

Values use_settings(const Place& place) {
  Values lengths;
  ubs::Settings settings;
  const char *key = nullptr, *help = nullptr;
  for (std::size_t i = 0;; ++i) {
    ubs::check(ubs_settings_describe(i, &key, &help));
    if (!key) break;
    lengths.push_back(static_cast<float>(settings.get(key).size() + std::string(help).size()));
  }
  settings.load(place / "settings.yaml").set("dim", 7).check_effect(UBS_USE_TRAINER);
  try {
    settings.set("iteration", 1);
    throw std::runtime_error("an unknown setting is accepted");
  } catch (const ubs::Exception& error) {
    if (error.status() != UBS_ERROR_USAGE) throw;
  }
  return lengths;
}

Values make_scene(const Place& place) {
  ubs_synthetic scene{};
  scene.scene = "glossy";
  scene.width = scene.height = 16;
  scene.train_views = 2;
  scene.test_views = 1;
  scene.supersampling = 1;
  ubs::Data::synthesise(scene, place.own("scene"));
  return pixels_of(ubs::Data(place.own("scene")));
}

Values make_data(const Place&) {
  ubs::Data data;
  const ubs_camera camera = front_camera();
  const Values points{0, 0, 0, 1, 0, 0, 0, 1, 0};
  const std::vector<std::uint8_t> rgb(3 * 24 * 24, 100), mask(24 * 24, 255);
  ubs::check(ubs_data_add_view(data.get(), "train", nullptr, &camera, rgb.data(), mask.data()));
  data.set_points(points);
  return values_of(ubs::Model::initial(data, ubs::Settings().set("dim", 3)));
}

Values open_data(const Place& place) { return pixels_of(ubs::Data(place / "data")); }

Values open_bitmaps(const Place& place) { return pixels_of(ubs::Data(place / "bitmaps")); }  // uses OpenCV

Values convert_model(const Place& place) {
  const ubs::Model model(place / "model.ply");
  model.save(place.own("model.ubsz"));
  model.save(place.own("model.ply"), "3dgs");
  for (const std::string format : {"spz", "sog", "glb", "usda", "splat"})
    model.save(place.own("model." + format), format);
  return values_of(ubs::Model(place.own("model.spz")));
}

Values render(const Place& place) {
  const ubs::Device device;
  const ubs::Model model(place / "model.ply");
  ubs::Model gradient = model.like(model.info().splats);
  ubs::Renderer renderer(device, model, UBS_RENDER_DEPTH | UBS_RENDER_GRADIENTS);
  Values rgb = renderer.draw(front_camera()).rgb;
  renderer.loss(front_camera(), Values(rgb.size(), 0.5f), 0.2f, &gradient);
  const Values values = values_of(gradient);
  rgb.insert(rgb.end(), values.begin(), values.end());
  return rgb;
}

Values train(const Place& place) {
  const ubs::Device device;
  ubs::Settings settings;
  settings.load(place / "settings.yaml");
  const ubs::Data data(place / "data");
  ubs::Trainer trainer(device, data, settings);
  trainer.run({}, 3);
  trainer.save(place.own("checkpoint"));
  trainer.run({}, 3);
  trainer.restore(place.own("checkpoint"));
  return values_of(trainer.model());
}

Values compare(const Place&) {
  const ubs::Device device;
  const Values truth(3 * 16 * 16, 0.25f), image(3 * 16 * 16, 0.5f);
  return {static_cast<float>(ubs::Meter(device).compare(16, 16, truth, image).psnr)};
}

using Action = Values (*)(const Place&);
constexpr std::array<std::pair<std::string_view, Action>, 12> kActions{{{"library", call_library},
                                                                        {"devices", list_devices},
                                                                        {"open", open_device},
                                                                        {"render", render},
                                                                        {"train", train},
                                                                        {"compare", compare},
                                                                        {"settings", use_settings},
                                                                        {"synthesise", make_scene},
                                                                        {"arrays", make_data},
                                                                        {"data", open_data},
                                                                        {"bitmaps", open_bitmaps},
                                                                        {"convert", convert_model}}};

}  // namespace

int main(int count, char** arguments) {
  if (count != 3) return 2;
  const std::string_view wanted = arguments[1];
  const bool mixed = wanted == "mixed";
  const auto chosen = [&](std::size_t action, std::size_t thread) {
    return mixed ? action % kThreads == thread : kActions[action].first == wanted;
  };
  std::array<Values, kThreads> results;
  std::array<std::string, kThreads> problems;
  std::barrier start(kThreads);
  const auto work = [&](std::size_t thread) {
    start.arrive_and_wait();
    try {
      for (std::size_t action = 0; action < kActions.size(); ++action)
        if (chosen(action, thread)) results[thread] = kActions[action].second({arguments[2], thread});
      if (results[thread].empty()) problems[thread] = "there is no result";
    } catch (const std::exception& error) {
      problems[thread] = error.what();
    }
  };
  {
    std::vector<std::jthread> threads;
    for (std::size_t thread = 0; thread < kThreads; ++thread) threads.emplace_back(work, thread);
  }
  int code = 0;
  for (std::size_t thread = 0; thread < kThreads; ++thread) {
    if (problems[thread].empty() && !mixed && results[thread] != results[0])
      problems[thread] = "the result differs from that of the first thread";
    if (problems[thread].empty()) continue;
    std::fprintf(stderr, "thread %zu: %s\n", thread, problems[thread].c_str());
    code = 1;
  }
  return code;
}
