/* SPDX-License-Identifier: Apache-2.0
 *
 * ubs: Universal Beta Splatting as a library. It opens devices and data, trains models, draws them, and gives
 * the gradients of what is drawn with respect to every raw parameter. C99; C++ has ubs.hpp over it. Examples:
 * docs/library.md. A program that draws calls ubs_device_open, ubs_model_load, ubs_renderer_create and
 * ubs_renderer_draw; one that trains calls ubs_device_open, ubs_data_open, ubs_trainer_create,
 * ubs_trainer_run and ubs_trainer_get_model.
 *
 * - Errors: functions that can fail return a ubs_status. Where it is not UBS_OK, ubs_error_message() says in
 *   one line what is wrong and what to do, and what the function would have written is left alone (but for
 *   images of a device that fails while they are copied); new handles become NULL.
 *
 * - Handles: what _create, _open, _load and _copy give, and a model or settings that a _get function makes,
 *   is freed by the _free of its type, which takes NULL too. The order does not matter: what is made from a
 *   handle holds what it needs of it.
 *
 * - Memory: arrays that are passed in are copied before the function returns. Arrays that are passed out
 *   belong to the caller and have room for what the function says. Pointers into a handle are good until
 *   it is freed.
 *
 * - Images: rows from the top, tightly packed. float: (height, width, 3), RGB, 0 to 1; alpha and depth
 *   (height, width).
 *
 * - World: right-handed, lengths are those of the data. Cameras have COLMAP's axes: x right, y down, z
 *   forward.
 *
 * - Structs begin with `size`, to be set to sizeof by the caller before every call, so that later versions
 *   may add members at the end: ubs_camera camera = {sizeof camera}; the other members are then 0.
 *
 * - Threads: any thread may call any function. Calls that use the same device handle wait for one another,
 *   those on different ones do not. Nobody may use or free a handle while another thread changes it: a
 *   function changes the handle that it takes without `const`. Error messages belong to their thread.
 *
 * - Results: the same settings, data, device and build give the same bits, whether from here, Python or the
 *   executable.
 */
#ifndef UBS_UBS_H
#define UBS_UBS_H

#include <stddef.h>
#include <stdint.h>

#if defined(__GNUC__)
#define UBS_API __attribute__((visibility("default")))
#else
#define UBS_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Grows when a function or struct changes so that programs must be compiled again. */
#define UBS_ABI_VERSION 1

/* The numbers are the exit codes of the executable. */
typedef enum ubs_status {
  UBS_OK = 0,
  UBS_ERROR_INTERNAL = 1,  /* a broken promise of ours: please report */
  UBS_ERROR_USAGE = 2,     /* wrong arguments or settings */
  UBS_ERROR_DATA = 3,      /* unreadable, corrupt or inconsistent input; a file that cannot be written */
  UBS_ERROR_DEVICE = 4,    /* no such device, driver failure */
  UBS_ERROR_BUILD = 5,     /* kernels do not compile on this device */
  UBS_ERROR_MEMORY = 6,    /* not enough memory, of the host or the device */
  UBS_ERROR_NUMERICAL = 7, /* a value that is not finite */
  UBS_ERROR_FAULTY = 10    /* a device that computes wrong results (docs/check.md) */
} ubs_status;

typedef struct ubs_device ubs_device;
typedef struct ubs_settings ubs_settings;
typedef struct ubs_data ubs_data;
typedef struct ubs_model ubs_model;
typedef struct ubs_renderer ubs_renderer;
typedef struct ubs_trainer ubs_trainer;
typedef struct ubs_meter ubs_meter;

/* ---- Library ---- */

/* UBS_ABI_VERSION and version ("0.2.0") of the library that is loaded. */
UBS_API uint32_t ubs_abi_version(void);
UBS_API const char* ubs_version(void);

/* Why the last call of this thread that failed did. Never NULL; good until this thread's next failure. */
UBS_API const char* ubs_error_message(void);

/* Receives lines of text: level 0, what takes time; 1, warnings. Called by one thread at a time, from inside
 * of other calls; it must not throw. NULL: warnings go to stderr, as at the beginning. For the whole process.
 */
typedef void (*ubs_log_function)(void* user, int level, const char* line);
UBS_API void ubs_set_log(ubs_log_function function, void* user);

/* ---- Devices ---- */

typedef enum ubs_device_type {
  UBS_DEVICE_CPU = 0,
  UBS_DEVICE_GPU = 1,
  UBS_DEVICE_ACCELERATOR = 2
} ubs_device_type;

typedef struct ubs_device_info {
  size_t size;
  char backend[16]; /* "opencl", "cuda" */
  char platform[128], vendor[128], name[256], driver[128];
  int32_t type; /* ubs_device_type */
  uint32_t compute_units;
  uint64_t memory_bytes, max_allocation_bytes;
  uint64_t allocated_bytes, peak_bytes; /* by this handle; 0 for a device that is not open */
} ubs_device_info;

UBS_API ubs_status ubs_device_count(size_t* count);
/* The device at `index` (below the count), as `ubs devices` lists it. */
UBS_API ubs_status ubs_device_describe(size_t index, ubs_device_info* info);

/* `request`: "0" (an index), "cpu", "gpu", "cuda", "opencl", or a part of a name; NULL or "": the environment
 * variable UBS_DEVICE, else the first GPU, else the first device. A device may be opened several times.
 * Before the first use of a form of model the device is compared with float64, once for each device, driver
 * and build, which takes seconds: UBS_ERROR_FAULTY where it computes wrong results. UBS_CHECK=off in the
 * environment: not. */
UBS_API ubs_status ubs_device_open(const char* request, ubs_device** device);
UBS_API ubs_status ubs_device_get_info(const ubs_device* device, ubs_device_info* info);
UBS_API void ubs_device_free(ubs_device* device);

/* ---- Settings: by name, with the values that `ubs train --help` and YAML files have ---- */

UBS_API ubs_status ubs_settings_create(ubs_settings** settings);
UBS_API ubs_status ubs_settings_copy(const ubs_settings* settings, ubs_settings** copy);
UBS_API void ubs_settings_free(ubs_settings* settings);
/* Those of a YAML file; its keys that are not there stay as they are. */
UBS_API ubs_status ubs_settings_load(ubs_settings* settings, const char* path);
/* UBS_ERROR_USAGE for unknown keys and values out of range: "iterations", "7000"; "background", "1,1,1". */
UBS_API ubs_status ubs_settings_set(ubs_settings* settings, const char* key, const char* value);
/* The value as text with its 0, as far as `capacity` bytes hold it; *length is that of the whole text without
 * it. */
UBS_API ubs_status ubs_settings_get(const ubs_settings* settings, const char* key, char* value,
                                    size_t capacity, size_t* length);
/* Name and explanation of the setting number `index`; both NULL behind the last one. Good for ever. */
UBS_API ubs_status ubs_settings_describe(size_t index, const char** key, const char** help);

/* ---- Data: views with cameras and images, in the splits "train", "test" and "val" ---- */

typedef struct ubs_camera {
  size_t size;
  double world_to_camera[12]; /* (3, 4) row-major, rotation and translation: p_camera = R p_world + t */
  double fx, fy, cx, cy; /* focal lengths and principal point [px]; the first pixel's centre is (0.5, 0.5) */
  int32_t width, height; /* [px] */
  double time;           /* of models with time, 0 to 1 over the training views */
  uint32_t extra_count;  /* further query values for N = 5 and from 8 on, at most 4 */
  double extra[4];
} ubs_camera;

typedef struct ubs_view {
  size_t size;
  ubs_camera camera; /* its size need not be set */
  int32_t has_image, has_mask;
  char name[256];
} ubs_view;

/* A folder of any known layout, or a packed file (docs/data.md). `settings` decide layout, background,
 * downscale, frames and so on; NULL: defaults. */
UBS_API ubs_status ubs_data_open(const char* path, const ubs_settings* settings, ubs_data** data);
/* An empty data set, to be filled by the two functions below. */
UBS_API ubs_status ubs_data_create(ubs_data** data);
UBS_API void ubs_data_free(ubs_data* data);
/* Appends a view. `name`: unique in its split, a file name without extension; NULL: its number. `rgb`:
 * (height, width, 3) bytes, already on the background; NULL: a view without image. `mask`: (height, width)
 * bytes, 0: the pixel does not count; or NULL. */
UBS_API ubs_status ubs_data_add_view(ubs_data* data, const char* split, const char* name,
                                     const ubs_camera* camera, const uint8_t* rgb, const uint8_t* mask);
/* Points that a model is initialised from: positions (count, 3) in the world, colours (count, 3) or NULL. */
UBS_API ubs_status ubs_data_set_points(ubs_data* data, size_t count, const float* positions,
                                       const uint8_t* colours);
/* 0 for a split that is not there. */
UBS_API ubs_status ubs_data_view_count(const ubs_data* data, const char* split, size_t* count);
UBS_API ubs_status ubs_data_get_view(const ubs_data* data, const char* split, size_t index, ubs_view* view);
/* rgb: (height, width, 3); mask: (height, width), 255 everywhere for views without one, or NULL.
 * UBS_ERROR_DATA for views without image. */
UBS_API ubs_status ubs_data_get_image(const ubs_data* data, const char* split, size_t index, uint8_t* rgb,
                                      uint8_t* mask);

/* ---- Models: raw parameters in host memory ---- */

typedef struct ubs_model_info {
  size_t size;
  uint32_t dim;        /* N, of the first group */
  uint32_t groups;     /* 1, or more for models whose splats differ in dimensions */
  uint64_t splats;     /* of all groups */
  uint64_t parameters; /* floats */
  double offset[3];    /* positions of splats are relative to it: world = xyz + offset */
  char form[256];      /* "default", or the switches of docs/variants.md that differ */
} ubs_model_info;

typedef struct ubs_parameter {
  size_t size;
  /* "xyz", "rgb", "opacity", "beta", "mean", "scale", "l_triangle" and so on (docs/method.md 1.2); NULL:
   * there is no parameter of this number. */
  const char* name;
  uint32_t dim; /* N of the group */
  uint32_t rows;
  uint64_t splats;
  float* values; /* (rows, splats) row-major, inside the model: may be read and written */
} ubs_parameter;

/* `splats` splats with all parameters 0, of the dimension and form that the settings say ("dim" must be a
 * number). */
UBS_API ubs_status ubs_model_create(const ubs_settings* settings, uint64_t splats, ubs_model** model);
/* What a training with these settings begins with: from the points of the data, else in a box. */
UBS_API ubs_status ubs_model_create_initial(const ubs_data* data, const ubs_settings* settings,
                                            ubs_model** model);
UBS_API ubs_status ubs_model_copy(const ubs_model* model, ubs_model** copy);
UBS_API void ubs_model_free(ubs_model* model);
/* A model file of any known format (docs/data.md), or the folder of a finished run. */
UBS_API ubs_status ubs_model_load(const char* path, ubs_model** model);
/* `format`: a name of `ubs convert --to`; "ubs" loses nothing, and so is NULL; "auto" goes by the extension of the path
 * and takes "ubs" for .ply and for unknown ones. Other formats get the model at `time`, with directions averaged over
 * the cameras that the model notes, if any. Replaces a file of that name, but neither a link nor a folder. */
UBS_API ubs_status ubs_model_save(const ubs_model* model, const char* path, const char* format, double time);
UBS_API ubs_status ubs_model_get_info(const ubs_model* model, ubs_model_info* info);
/* Parameter number `index` (from 0) of a group (below the model's `groups`). */
UBS_API ubs_status ubs_model_get_parameter(ubs_model* model, uint32_t group, uint32_t index,
                                           ubs_parameter* parameter);
/* How the model wants to be drawn: the defaults, and in their place background, near and far plane, blur and
 * alpha_min as its file says, dimension and form. */
UBS_API ubs_status ubs_model_get_settings(const ubs_model* model, ubs_settings** settings);

/* ---- Renderers: a model on a device ---- */

enum { UBS_RENDER_DEPTH = 1, UBS_RENDER_GRADIENTS = 2 }; /* flags */

typedef struct ubs_image {
  size_t size;
  float* rgb;   /* (height, width, 3), not clamped; or NULL: not wanted */
  float* alpha; /* (height, width); or NULL */
  float* depth; /* (height, width), expected depth [world]; or NULL. Needs UBS_RENDER_DEPTH */
} ubs_image;

typedef struct ubs_image_gradient {
  size_t size;
  const float* rgb;   /* (height, width, 3); or NULL: 0 */
  const float* alpha; /* (height, width); or NULL: 0 */
  const float* depth; /* the same; needs UBS_RENDER_DEPTH, is without effect where alpha < 1e-6 */
} ubs_image_gradient;

/* With respect to a camera, of changes that leave its rotation one. */
typedef struct ubs_camera_gradient {
  size_t size;
  double pose[6]; /* of moves in the camera's frame: turns about its axes [1/rad], then shifts along them:
                     (R, t) -> (exp([w]) R, exp([w]) t + u) */
  double world_to_camera[12]; /* the same for the matrix, (3, 4) */
  double fx, fy, cx, cy, time;
  double extra[4];
} ubs_camera_gradient;

typedef struct ubs_loss {
  size_t size;
  double loss; /* (1 - lambda) l1 + lambda (1 - ssim) */
  double l1, ssim;
} ubs_loss;

/* Copies the model to the device. `settings`: NULL: as the model wants to be drawn. `flags`: what will be
 * asked for. */
UBS_API ubs_status ubs_renderer_create(ubs_device* device, const ubs_model* model,
                                       const ubs_settings* settings, unsigned flags, ubs_renderer** renderer);
UBS_API void ubs_renderer_free(ubs_renderer* renderer);
/* Other values of the parameters: a model of the same groups, dimensions and form with at most as many
 * splats. */
UBS_API ubs_status ubs_renderer_update(ubs_renderer* renderer, const ubs_model* model);
UBS_API ubs_status ubs_renderer_draw(ubs_renderer* renderer, const ubs_camera* camera,
                                     const ubs_image* image);
/* Vector-Jacobian product: draws the view, and from the gradient of a number with respect to its pixels makes
 * that with respect to every raw parameter, in place of each in `gradient` (a ubs_model_copy of the model;
 * NULL: only the camera's is wanted). Needs UBS_RENDER_GRADIENTS. */
UBS_API ubs_status ubs_renderer_vjp(ubs_renderer* renderer, const ubs_camera* camera,
                                    const ubs_image_gradient* v_image, ubs_model* gradient);
/* The loss of training against `target` (height, width, 3), with weight lambda_dssim of 1 - SSIM, and its
 * gradient without regularisers as above (NULL: the loss alone). `mask`: (height, width) bytes, 0: does not
 * count; or NULL. */
UBS_API ubs_status ubs_renderer_loss(ubs_renderer* renderer, const ubs_camera* camera, const float* target,
                                     const uint8_t* mask, float lambda_dssim, ubs_loss* loss,
                                     ubs_model* gradient);

/* With respect to the camera, of the number whose gradient the renderer gave last; what the view direction
 * does to the splats is in it, also where the setting query_grad leaves it out of the parameters' gradients.
 * UBS_ERROR_USAGE before a sky of harmonics. */
UBS_API ubs_status ubs_renderer_camera_gradient(ubs_renderer* renderer, ubs_camera_gradient* gradient);

/* Arrays of a renderer in the memory of its device, for programs that compute there too. Devices of CUDA and
 * CPUs with PoCL have them: UBS_ERROR_USAGE on others, whose OpenCL gives no addresses. */
typedef enum ubs_array_name {
  UBS_ARRAY_PARAMETERS = 0, /* (rows, splats), rows in the order of ubs_model_get_parameter; may be written */
  UBS_ARRAY_RGB = 1, /* (height, width, 3), of the picture drawn last; not after v_image.alpha or depth */
  UBS_ARRAY_TRANSMITTANCE = 2, /* (height, width): 1 - alpha */
  UBS_ARRAY_DEPTH = 3,         /* (height, width) */
  UBS_ARRAY_V_RGB = 4,   /* zeros of the (height, width) that the caller's `shape` begins with, to be written,
                            and given to ubs_renderer_vjp as rgb, without alpha */
  UBS_ARRAY_GRADIENT = 5 /* as the parameters, of the number whose gradient the renderer gave last */
} ubs_array_name;

typedef struct ubs_array {
  size_t size;
  float* values;         /* an address of the device */
  int32_t type, ordinal; /* of the device as DLPack has them: 2, and CUDA's number; 1 and 0 for a CPU */
  int32_t dims;
  int64_t shape[3], strides[3]; /* [floats] */
} ubs_array;

/* Waits for the renderer. The program must be done with the array before its next call that uses this device.
 * Good until the renderer draws a view of another size. `group` of splats as of models, for parameters and
 * gradient. */
UBS_API ubs_status ubs_renderer_get_array(ubs_renderer* renderer, ubs_array_name name, uint32_t group,
                                          ubs_array* array);

/* ---- Training ---- */

typedef struct ubs_step {
  size_t size;
  uint32_t iteration, iterations; /* done, of all */
  double seconds;                 /* of training so far */
  uint64_t splats;
  double loss;                 /* mean since it was given last; NaN where it is not (the setting log_every) */
  double test_psnr, test_ssim; /* NaN in iterations without evaluation (eval_every, and the last) */
} ubs_step;

typedef struct ubs_metrics {
  size_t size;
  double psnr;       /* [dB], mean over the channels of 10 log10(1 / mse), as published code has it */
  double psnr_joint; /* of the mean squared error of all channels */
  double ssim;       /* 11 x 11 Gaussian, zero-padded */
  double ssim_valid; /* over the windows inside of the image; NaN where there is none */
  /* NaN for networks not asked for. Fed with 2 v - 1, and with v, as in published evaluations of splats. */
  double lpips_alex, lpips_squeeze, lpips_vgg;
  double lpips_alex_unit, lpips_squeeze_unit, lpips_vgg_unit;
} ubs_metrics;

/* Called after every iteration; 0 stops the run there. May use other handles, and read the trainer. */
typedef int (*ubs_step_function)(void* user, const ubs_step* step);

/* With the settings of `ubs train` (NULL: defaults). Those that decide how data are read must be the ones
 * that `data` has been opened with. `initial`: NULL: as ubs_model_create_initial() makes it; else one of the
 * settings' dimension and form. */
UBS_API ubs_status ubs_trainer_create(ubs_device* device, const ubs_data* data, const ubs_settings* settings,
                                      const ubs_model* initial, ubs_trainer** trainer);
UBS_API void ubs_trainer_free(ubs_trainer* trainer);
/* Trains for `steps` iterations, or to the end: 0, or more than are left. `function` may be NULL. After an
 * error the trainer holds the state of the last whole iteration, where there is one. */
UBS_API ubs_status ubs_trainer_run(ubs_trainer* trainer, uint32_t steps, ubs_step_function function,
                                   void* user);
/* Where it stands; loss and metrics are NaN. */
UBS_API ubs_status ubs_trainer_get_status(const ubs_trainer* trainer, ubs_step* step);
/* The model as it is now. */
UBS_API ubs_status ubs_trainer_get_model(const ubs_trainer* trainer, ubs_model** model);
/* Mean over the test views. UBS_ERROR_DATA without any. */
UBS_API ubs_status ubs_trainer_evaluate(ubs_trainer* trainer, ubs_metrics* metrics);
/* A checkpoint, and going on from one, of a trainer made with the same data, settings and device: with the
 * same bits as without interruption. Else UBS_ERROR_USAGE or UBS_ERROR_DATA, which name what differs. */
UBS_API ubs_status ubs_trainer_save(const ubs_trainer* trainer, const char* path);
UBS_API ubs_status ubs_trainer_restore(ubs_trainer* trainer, const char* path);

/* ---- Comparing images ---- */

/* `networks`: of LPIPS, "alex,squeeze,vgg", NULL or "": none. `weights`: a safetensors file, or a folder of
 * lpips_NAME.safetensors (docs/metrics.md); NULL: the environment variable UBS_LPIPS_WEIGHTS. */
UBS_API ubs_status ubs_meter_create(ubs_device* device, const char* networks, const char* weights,
                                    ubs_meter** meter);
UBS_API void ubs_meter_free(ubs_meter* meter);
/* Both images (height, width, 3), clamped to 0 to 1. */
UBS_API ubs_status ubs_meter_compare(ubs_meter* meter, int32_t width, int32_t height, const float* truth,
                                     const float* image, ubs_metrics* metrics);

#ifdef __cplusplus
}
#endif

#endif /* UBS_UBS_H */
