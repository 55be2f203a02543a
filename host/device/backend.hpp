// SPDX-License-Identifier: Apache-2.0
// The contract of a back end: this header includes all that a back end provides and all that it may use from
// the rest of ubs.
//
// A back end provides, in a folder of its own:
//   Device     memory, copies, the queue, times                                    device.hpp
//   Stages     one function run() that executes an Operation                       stages.hpp
//   MetricOps  the operations of image metrics                                     metric_ops.hpp
//   TunableDevice, if `ubs-lab tune` shall choose constants of its kernels         tuning.hpp
//   Backend    its row in the table of registry.cpp: functions that list and open  registry.hpp
//              its devices
// DeviceInfo says what its devices can do. The rest of ubs asks for these properties, never for the name of a
// back end. All devices support RasterKind::gpu. An operation may throw Error(device) if the back end does
// not implement it.
//
// A back end may use:
//   operation_checks.hpp  checks of the arguments of an operation, to be called before a kernel is launched
//   stage_sizes.hpp       sizes of buffers that the pipeline allocates for the stages, or the stages
//                         themselves; the memory estimate uses them too
//   kernel_sources.hpp    the text of the kernels in kernels/, whose language kernels/dialect/dialect.h
//                         defines; a back end with another language adds its words there
//   kernel_options.hpp    the macros that specialise these kernels for a KernelConfig
//   map_kernels.hpp       names and argument types of the kernels in kernels/map, and of those in kernels/gpu
//   map_stages.hpp, parameter_stages.hpp, map_metric_ops.hpp
//                         stages and image metrics that consist only of launches of such kernels, as
//                         templates over a class that launches a kernel
//
// The device tests (tests/stages, tests/pipeline, tests/stress) run on every device that is found. A back end
// is complete when they pass.
#pragma once

#include "host/device/device.hpp"
#include "host/device/kernel_options.hpp"
#include "host/device/kernel_sources.hpp"
#include "host/device/map_kernels.hpp"
#include "host/device/map_metric_ops.hpp"
#include "host/device/map_stages.hpp"
#include "host/device/metric_ops.hpp"
#include "host/device/operation_checks.hpp"
#include "host/device/parameter_stages.hpp"
#include "host/device/registry.hpp"
#include "host/device/stage_sizes.hpp"
#include "host/device/stages.hpp"
#include "host/device/tuning.hpp"
