// SPDX-License-Identifier: Apache-2.0
// These functions check whether a resumed run will give a result that is bit-identical to that of an
// uninterrupted run, and whether all ranks of a job run the same training.
#pragma once

#include <string>

#include "host/cluster/communicator.hpp"
#include "host/dataset/load_dataset.hpp"
#include "host/device/device.hpp"
#include "host/train/checkpoint.hpp"

namespace ubs {

// Returns a string with the properties of a device that results depend on: its name and driver, its vector
// width, and its tuned kernel constants.
std::string device_text(const DeviceInfo& info);

// Returns a checkpoint that identifies this run and contains no training state. `data` is the path or the
// name of the data, and `data_print` is the fingerprint() of the training views as they were read from the
// data.
Checkpoint identity(const TrainSettings& settings, std::string data, std::uint32_t data_print,
                    const Device& device);

// Compares the checkpoint `before` with the resumed run `now`. Throws Error(data) if they have different
// data, or if they have different devices and `any_device` is false. If the builds differ, logs a warning.
void check_same_run(const Checkpoint& before, const Checkpoint& now, bool any_device);

// Compares the runs of all ranks before training. Throws Error(usage) on all ranks if a rank has another
// build, other data or other settings. Stores the devices of all ranks in `run`, and returns the number of
// different devices. Logs a warning if there are several.
int join_run(Communicator& ranks, Checkpoint& run);

// Returns whether the training views of the data set have this fingerprint. The name of a data set in a file
// of a run may lead anywhere, so data are only used if they have the fingerprint in the file, or if the user
// names them.
bool has_fingerprint(const Dataset& data, std::uint32_t print);

}  // namespace ubs
