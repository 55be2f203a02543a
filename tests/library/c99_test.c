/* SPDX-License-Identifier: Apache-2.0
 * Tests the library as a C99 program uses it: creates a model of two splats, renders it, computes a gradient,
 * compares images, and checks the codes and messages of errors. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ubs/ubs.h"

enum { WIDTH = 24, HEIGHT = 16, PIXELS = WIDTH * HEIGHT };

static int failures = 0;

static void expect(int holds, const char* what) {
  if (holds) return;
  fprintf(stderr, "this expectation is not met: %s (last error: %s)\n", what, ubs_error_message());
  ++failures;
}
#define EXPECT(condition) expect((condition), #condition)

static int lines = 0;
static void count_lines(void* user, int level, const char* line) {
  (void)level;
  if (user == &lines && line[0] != 0) ++lines;
}

static ubs_parameter find(ubs_model* model, const char* name) {
  ubs_parameter p = {sizeof p};
  uint32_t index;
  for (index = 0;; ++index) {
    if (ubs_model_get_parameter(model, 0, index, &p) != UBS_OK || p.name == NULL) break;
    if (strcmp(p.name, name) == 0) return p;
  }
  expect(0, name);
  exit(1);
}

static ubs_model* two_splats(void) {
  ubs_settings* settings = NULL;
  ubs_model* model = NULL;
  ubs_parameter xyz, rgb, opacity, scale;
  size_t i;
  EXPECT(ubs_settings_create(&settings) == UBS_OK);
  EXPECT(ubs_settings_set(settings, "dim", "3") == UBS_OK);
  EXPECT(ubs_model_create(settings, 2, &model) == UBS_OK);
  ubs_settings_free(settings);
  if (model == NULL) exit(1);
  xyz = find(model, "xyz");
  rgb = find(model, "rgb");
  opacity = find(model, "opacity");
  scale = find(model, "scale");
  EXPECT(xyz.rows == 3 && xyz.splats == 2);
  xyz.values[0] = -0.4f;
  xyz.values[1] = 0.4f;
  for (i = 0; i < 2; ++i) xyz.values[2 * 2 + i] = 3; /* z */
  for (i = 0; i < 6; ++i) rgb.values[i] = 0.3f * (float)i - 0.5f;
  for (i = 0; i < 2; ++i) opacity.values[i] = 2;
  for (i = 0; i < 6; ++i) scale.values[i] = -0.5f;
  return model;
}

int main(void) {
  ubs_device* device = NULL;
  ubs_model *model, *gradient = NULL;
  ubs_renderer *renderer = NULL, *other = NULL;
  ubs_falloff falloff = {sizeof falloff, "beta*ubs_log2_1m(r)", "(-beta/(UBS_LN2*(V(1.0)-r)))", "ubs_log2_1m(r)", 1};
  ubs_meter* meter = NULL;
  ubs_camera camera = {sizeof camera};
  ubs_image image = {sizeof image};
  ubs_image_gradient v = {sizeof v};
  ubs_metrics metrics = {sizeof metrics};
  static float rgb[3 * PIXELS], alpha[PIXELS], depth[PIXELS], v_alpha[PIXELS];
  double light = 0, slope = 0;
  size_t i;

  EXPECT(ubs_abi_version() == UBS_ABI_VERSION);
  EXPECT(strlen(ubs_version()) > 0);
  ubs_set_log(count_lines, &lines);

  EXPECT(ubs_device_open("no such device", &device) == UBS_ERROR_DEVICE);
  EXPECT(device == NULL && strstr(ubs_error_message(), "no such device") != NULL);
  EXPECT(ubs_device_open(NULL, &device) == UBS_OK);

  model = two_splats();
  EXPECT(ubs_renderer_create(device, model, NULL, UBS_RENDER_DEPTH | UBS_RENDER_GRADIENTS, &renderer) ==
         UBS_OK);
  if (renderer == NULL) return 1;
  camera.world_to_camera[0] = camera.world_to_camera[5] = camera.world_to_camera[10] = 1;
  camera.fx = camera.fy = 20;
  camera.cx = WIDTH / 2.0;
  camera.cy = HEIGHT / 2.0;
  camera.width = WIDTH;
  camera.height = HEIGHT;
  image.rgb = rgb;
  image.alpha = alpha;
  image.depth = depth;
  EXPECT(ubs_renderer_draw(renderer, &camera, &image) == UBS_OK);
  for (i = 0; i < PIXELS; ++i) light += alpha[i];
  EXPECT(light > 1 && light < PIXELS);
  EXPECT(fabs(depth[HEIGHT / 2 * WIDTH + WIDTH / 2] - 3) < 1e-4);

  /* A higher opacity increases alpha, so the gradient of the sum of alpha must be positive. */
  EXPECT(ubs_model_copy(model, &gradient) == UBS_OK);
  for (i = 0; i < PIXELS; ++i) v_alpha[i] = 1;
  v.alpha = v_alpha;
  EXPECT(ubs_renderer_vjp(renderer, &camera, &v, gradient) == UBS_OK);
  for (i = 0; i < 2; ++i) slope += find(gradient, "opacity").values[i];
  EXPECT(slope > 0);

  EXPECT(ubs_meter_create(device, NULL, NULL, &meter) == UBS_OK);
  EXPECT(ubs_meter_compare(meter, WIDTH, HEIGHT, rgb, rgb, &metrics) == UBS_OK);
  EXPECT(isinf(metrics.psnr) && fabs(metrics.ssim - 1) < 1e-6 && isnan(metrics.lpips_alex));
  /* Images that are too large are refused before their pixels are read and before memory is allocated. */
  for (i = 0; i < 4; ++i) {
    static const int32_t sides[4][2] = {{65535, 65535}, {65536, 1}, {1, 2147483647}, {32768, 16385}};
    metrics.ssim = 0.5;
    EXPECT(ubs_meter_compare(meter, sides[i][0], sides[i][1], rgb, rgb, &metrics) == UBS_ERROR_USAGE);
    EXPECT(strstr(ubs_error_message(), "is not possible") != NULL && metrics.ssim == 0.5);
  }

  /* A renderer that gets the published falloff as expressions must give the same image. */
  EXPECT(ubs_renderer_create_falloff(device, model, NULL, 0, &falloff, &other) == UBS_OK);
  image.depth = NULL;
  image.alpha = v_alpha;
  EXPECT(ubs_renderer_draw(other, &camera, &image) == UBS_OK);
  for (i = 0; i < PIXELS; ++i) EXPECT(fabs(v_alpha[i] - alpha[i]) < 1e-6);
  ubs_renderer_free(other);
  falloff.log2 = "beta * r";
  EXPECT(ubs_renderer_create_falloff(device, model, NULL, 0, &falloff, &other) == UBS_ERROR_USAGE);
  EXPECT(other == NULL && strstr(ubs_error_message(), "without blanks") != NULL);
  image.depth = depth;
  image.alpha = alpha;

  image.size = 0;
  EXPECT(ubs_renderer_draw(renderer, &camera, &image) == UBS_ERROR_USAGE);
  EXPECT(ubs_renderer_draw(NULL, &camera, &image) == UBS_ERROR_USAGE);

  /* Objects may be freed in any order: the renderer still works after its device and its model are freed. */
  ubs_device_free(device);
  ubs_model_free(model);
  image.size = sizeof image;
  EXPECT(ubs_renderer_draw(renderer, &camera, &image) == UBS_OK);
  ubs_renderer_free(renderer);
  ubs_meter_free(meter);
  ubs_model_free(gradient);
  ubs_device_free(NULL);
  return failures == 0 ? 0 : 1;
}
