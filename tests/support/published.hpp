// SPDX-License-Identifier: Apache-2.0
// Settings of trainings with the published schedule. Most tests use it, because its values do not depend on
// the length of the run.
#pragma once

#include "host/settings/settle.hpp"

namespace ubs::test {

inline TrainSettings published(int dim = 6) {
  TrainSettings settings;
  settings.schedule = ScheduleKind::published;
  settings.dim = dim;
  settings.iterations = kScheduleLength;
  settings.cap_max = 300'000;
  settings.pyramid.clear();
  settings.refine = {500, 25000, 100};
  settings.growth = 1.02;
  settings.lr_cooldown = 0;
  return settings;
}

}  // namespace ubs::test
