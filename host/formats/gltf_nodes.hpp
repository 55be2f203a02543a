// SPDX-License-Identifier: Apache-2.0
// MeshPlaces finds the places at which the scene of a glTF file shows its meshes: it follows the hierarchy of
// nodes and the instances of the extension EXT_mesh_gpu_instancing.
#pragma once

#include <map>
#include <vector>

#include "host/formats/gltf_file.hpp"
#include "host/formats/splat_transform.hpp"
#include "host/scene/load_report.hpp"

namespace ubs {

inline constexpr const char* kInstancing = "EXT_mesh_gpu_instancing";

// The places of a mesh are transformations from its axes to those of the scene. A mesh that the scene does
// not show has no entry. Time is proportional to the number of nodes and instances.
using MeshPlaces = std::map<std::size_t, std::vector<Affine>>;

// Adds notes about scenes, nodes and instances that are not shown. Throws Error(data) if a transformation is
// invalid, or if the nodes do not form a tree.
MeshPlaces find_mesh_places(GltfFile& file, LoadReport& report);

}  // namespace ubs
