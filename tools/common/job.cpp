// SPDX-License-Identifier: Apache-2.0
#include "tools/common/job.hpp"

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <span>
#include <sstream>
#include <thread>

#include "host/cluster/mpi.hpp"
#include "host/device/registry.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/streams.hpp"

namespace ubs::tools {
namespace {

std::unique_ptr<Communicator>& job() {
  static std::unique_ptr<Communicator> ranks;
  return ranks;
}

// Returns the rank among the ranks on this machine.
std::size_t local_rank() {
  const std::vector<std::string> hosts = ranks().all_texts(host_name());
  const auto own = hosts.begin() + ranks().rank();
  return static_cast<std::size_t>(std::count(hosts.begin(), own, *own));
}

std::vector<std::string> cards() {
  std::vector<std::string> found;
  if (std::getenv("UBS_DEVICE")) return found;
  const std::vector<DeviceInfo> devices = list_devices();
  for (std::size_t i = 0; i < devices.size(); ++i)
    if (devices[i].type == DeviceType::gpu && same_card(devices, i) == i) found.push_back(std::to_string(i));
  return found;
}

}  // namespace

void join() {
  job() = join_job();
  if (ranks().rank() > 0) silence_out();
}

void leave() { job().reset(); }

Communicator& ranks() { return job() ? *job() : alone(); }

bool on_any_rank(bool here) {
  std::uint64_t ranks_where = here ? 1 : 0;
  ranks().sum(std::span(&ranks_where, 1));
  return ranks_where > 0;
}

std::string error_prefix() {
  if (ranks().first()) return "";
  std::this_thread::sleep_for(std::chrono::seconds(1));
  return "rank " + std::to_string(ranks().rank()) + ": ";
}

int end_with_error(int code) {
  if (job()) end_job(code);
  return code;
}

std::string device_of_rank(const std::string& request) {
  if (ranks().size() == 1) return request;
  std::vector<std::string> choices;
  std::istringstream words(request);
  for (std::string word; std::getline(words, word, ',');) choices.push_back(word);
  if (choices.empty()) choices = cards();
  const std::size_t local = local_rank();  // counts the ranks of this machine with other choices, too
  return choices.empty() ? request : choices[local % choices.size()];
}

}  // namespace ubs::tools
