// SPDX-License-Identifier: Apache-2.0
// This file replaces the other source files of this folder in builds without the server: without cpp-httplib
// or OpenCV, or with UBS_SERVE=OFF.
#include "host/base/error.hpp"
#include "host/look/serve/live.hpp"

namespace ubs::serve {
struct Server::Implementation {};
Server::Server(const Address&) {
  fail(ErrorKind::usage,
       "this build has no HTTP server: install cpp-httplib (Debian: libcpp-httplib-dev) and build with "
       "-DUBS_SERVE=ON");
}
Server::~Server() = default;
const std::string& Server::url() const {
  static const std::string none;
  return none;
}
std::uint64_t Server::requests() const { return 0; }

struct LiveTraining::Implementation {};
LiveTraining::LiveTraining(Server&, double, Device&, Trainer&, const TrainSettings&, const Scene&,
                           const TimeSource&) {}
LiveTraining::~LiveTraining() = default;
void LiveTraining::step(const StepReport&, bool) {}
void LiveTraining::end() {}
bool LiveTraining::has_viewer() const { return false; }
void LiveTraining::stay(const std::function<bool()>&) {}
std::string LiveTraining::summary() const { return {}; }

void serve_model(Server&, ModelSession&, const MixedModel&, const Scene&) {}

}  // namespace ubs::serve
