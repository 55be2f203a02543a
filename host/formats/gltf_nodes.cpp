// SPDX-License-Identifier: Apache-2.0
// See gltf_nodes.hpp.
#include "host/formats/gltf_nodes.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "host/base/error.hpp"

namespace ubs {
namespace {

template <std::size_t N>
std::array<double, N> node_numbers(const Json& node, const char* key, std::array<double, N> absent,
                                   const std::string& where) {
  if (!node.contains(key)) return absent;
  if (node[key].size() != N) fail(ErrorKind::data, "{}: '{}' must have {} numbers", where, key, N);
  node[key].get_to(absent);
  return absent;
}

// Returns the transformation of translation, rotation (x y z w) and scale, which are applied in the opposite
// order.
Affine affine_of(const Vec3& move, const std::array<double, 4>& q, const Vec3& scale) {
  return translation(move) * rotation({q[3], q[0], q[1], q[2]}) * scaling(scale);
}

Affine affine_of_node(const Json& node, std::size_t index, const std::string& name) {
  const std::string where = fmt::format("{}: node {}", name, index);
  const bool parts = node.contains("translation") || node.contains("rotation") || node.contains("scale");
  if (parts && node.contains("matrix"))
    fail(ErrorKind::data, "{} has a matrix and also a translation, rotation or scale: only one is allowed",
         where);
  Affine affine = affine_of(node_numbers<3>(node, "translation", {0, 0, 0}, where),
                            node_numbers<4>(node, "rotation", {0, 0, 0, 1}, where),
                            node_numbers<3>(node, "scale", {1, 1, 1}, where));
  if (node.contains("matrix")) {  // stored column by column
    const auto m = node_numbers<16>(node, "matrix", {}, where);
    for (std::size_t r = 0; r < 3; ++r) {
      for (std::size_t c = 0; c < 3; ++c) affine.linear[r][c] = m[4 * c + r];
      affine.move[r] = m[12 + r];
    }
    if (!is_affine_row(m[3], m[7], m[11], m[15]))
      fail(ErrorKind::data, "{}: the last row of the matrix must be 0 0 0 1", where);
  }
  if (!is_finite(affine))
    fail(ErrorKind::data, "{} has a transformation that is not finite, or a rotation of length 0", where);
  return affine;
}

// Returns the places of the instances of a node, relative to the node. Without the extension, it is the node
// itself.
std::vector<Affine> instances_of(GltfFile& file, const Json& node, std::size_t index) {
  if (!node.contains("extensions") || !node["extensions"].contains(kInstancing)) return {Affine{}};
  const Json& attributes = node["extensions"][kInstancing].at("attributes");
  std::optional<std::size_t> count;
  const auto get = [&](const char* key, std::size_t width) {
    if (!attributes.contains(key)) return std::vector<float>();
    const auto accessor = attributes[key].get<std::size_t>();
    if (count && *count != file.count(accessor))
      fail(ErrorKind::data,
           "{}: the attributes of the instances of node {} have different numbers of elements", file.name(),
           index);
    count = file.count(accessor);
    return file.read(accessor, width, *count);
  };
  const std::vector<float> moves = get("TRANSLATION", 3), turns = get("ROTATION", 4),
                           scales = get("SCALE", 3);
  if (!count)
    fail(ErrorKind::data, "{}: the instances of node {} have no TRANSLATION, ROTATION or SCALE", file.name(),
         index);
  std::vector<Affine> places;
  for (std::size_t i = 0; i < *count; ++i) {
    Vec3 move{0, 0, 0}, scale{1, 1, 1};
    std::array<double, 4> turn{0, 0, 0, 1};
    if (!moves.empty()) std::copy_n(&moves[3 * i], 3, move.begin());
    if (!turns.empty()) std::copy_n(&turns[4 * i], 4, turn.begin());
    if (!scales.empty()) std::copy_n(&scales[3 * i], 3, scale.begin());
    places.push_back(affine_of(move, turn, scale));
    if (!is_finite(places.back()))
      fail(ErrorKind::data,
           "{}: instance {} of node {} has a transformation that is not finite, or a rotation of "
           "length 0",
           file.name(), i, index);
  }
  return places;
}

bool hidden(const Json& node) {
  if (!node.contains("extensions")) return false;
  const Json& extensions = node["extensions"];
  return extensions.contains("KHR_node_visibility") &&
         !extensions["KHR_node_visibility"].value("visible", true);
}

// Returns the nodes that the scene lists. Without a scene, these are the nodes without a parent.
std::vector<std::size_t> roots_of(const Json& json, LoadReport& report) {
  std::vector<std::size_t> roots;
  if (json.contains("scenes") && !json["scenes"].empty()) {
    const auto shown = json.value("scene", std::size_t{0});
    const Json& scene = json["scenes"].at(shown);
    if (json["scenes"].size() > 1)
      report.note(fmt::format("only scene {} of {} is read", shown, json["scenes"].size()));
    if (scene.contains("nodes")) scene["nodes"].get_to(roots);
    return roots;
  }
  std::vector<char> child(json.at("nodes").size(), 0);
  for (const Json& node : json.at("nodes"))
    if (node.contains("children"))
      for (const Json& index : node["children"]) child.at(index.get<std::size_t>()) = 1;
  for (std::size_t n = 0; n < child.size(); ++n)
    if (!child[n]) roots.push_back(n);
  return roots;
}

}  // namespace

MeshPlaces find_mesh_places(GltfFile& file, LoadReport& report) {
  MeshPlaces places;
  const Json& json = file.json();
  if (!json.contains("nodes")) return places;
  const Json& nodes = json["nodes"];
  std::vector<char> visited(nodes.size(), 0);
  std::vector<std::pair<std::size_t, Affine>> open;  // nodes to visit, and the places of their parents
  const std::vector<std::size_t> roots = roots_of(json, report);
  for (auto root = roots.rbegin(); root != roots.rend(); ++root) open.emplace_back(*root, Affine{});
  std::size_t invisible = 0, flat = 0;
  while (!open.empty()) {
    const auto [index, above] = std::move(open.back());
    open.pop_back();
    if (std::exchange(visited.at(index), 1))
      fail(ErrorKind::data, "{}: node {} is listed twice, so the nodes do not form a tree", file.name(),
           index);
    const Json& node = nodes[index];
    if (hidden(node)) {
      ++invisible;
      continue;
    }
    const Affine place = above * affine_of_node(node, index, file.name());
    if (node.contains("mesh"))
      for (const Affine& instance : instances_of(file, node, index)) {
        const Affine whole = place * instance;
        if (inverse(whole))
          places[node["mesh"].get<std::size_t>()].push_back(whole);
        else
          ++flat;
      }
    if (node.contains("children"))
      for (auto child = node["children"].rbegin(); child != node["children"].rend(); ++child)
        open.emplace_back(child->get<std::size_t>(), place);
  }
  if (invisible > 0)
    report.note(fmt::format("{} nodes are not visible (KHR_node_visibility): not read", invisible));
  if (flat > 0) report.note(fmt::format("{} meshes are not read, because a scale is 0", flat));
  return places;
}

}  // namespace ubs
