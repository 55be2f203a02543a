// SPDX-License-Identifier: Apache-2.0
// Renders a model with one splat, and checks that the splat is in the middle of the image.
#include <cstdio>
#include <ubs/ubs.hpp>

int main() try {
  ubs::Model model(ubs::Settings().set("dim", 3), 1);
  model.parameter("xyz").values[2] = 3;
  model.parameter("opacity").values[0] = 3;
  auto camera = ubs::sized<ubs_camera>();
  for (int i = 0; i < 3; ++i) camera.world_to_camera[5 * i] = 1;
  camera.fx = camera.fy = 30;
  camera.cx = camera.cy = 16;
  camera.width = camera.height = 32;
  const ubs::Picture picture = ubs::Renderer(ubs::Device(), model).draw(camera);
  const float alpha = picture.alpha[16 * 32 + 16];
  std::printf("ubs %s: alpha %.3f in the middle, %.3f at the corner\n", ubs_version(), alpha,
              picture.alpha[0]);
  return alpha > 0.5f && picture.alpha[0] < 0.5f ? 0 : 1;
} catch (const ubs::Exception& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return 1;
}
