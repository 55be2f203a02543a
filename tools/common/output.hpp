// SPDX-License-Identifier: Apache-2.0
// These functions print output and make JSON objects for several subcommands (see also
// tools/common/streams.hpp). Numbers that JSON cannot express, such as the infinite PSNR of an exact image,
// become null.
#pragma once

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "host/base/json.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/device/device.hpp"
#include "host/scene/load_report.hpp"
#include "host/scene/mixed_model.hpp"
#include "host/train/evaluate.hpp"
#include "tools/common/streams.hpp"

namespace ubs::tools {

void print_json(const Json& json);
// Prints layout and notes of the loader to stdout, then warns about everything that was skipped.
void print_report(const LoadReport& report);
std::string json_file_text(const Json& json);

Json report_json(const LoadReport& report);
Json device_json(const DeviceInfo& info);
Json groups_json(const MixedModel& model);  // [{"dim": 6, "splats": 100}, ...]
// Returns the quantiles {"0%": minimum, "5%", "25%", "50%", "75%", "95%", "100%": maximum}. Each of them is
// one of the values (the nearest rank). They are null if there are no values.
Json quantiles_json(std::vector<double> values);
// `Measured` is ViewMetrics or FittedMetrics.
template <typename Measured>
Json quality_json(const Measured& m) {
  return {{"psnr", m.psnr_channel_mean}, {"psnr_joint", m.psnr}, {"ssim", m.ssim}};
}
Json metrics_json(const Metrics& metrics);  // {"mean": {...}, "views": [...]}
// Returns a string such as "PSNR 31.42 dB (joint 31.20), SSIM 0.9612 (valid 0.9655), lpips_alex 0.03120".
std::string metrics_text(const ViewMetrics& metrics);

}  // namespace ubs::tools
