/* SPDX-License-Identifier: Apache-2.0
 *
 * ubs.h is the C interface of ubs (Universal Beta Splatting) as a library. It opens devices and data, trains
 * and renders models, and computes gradients of rendered images with respect to every raw parameter. It
 * requires C99; ubs.hpp wraps it for C++. Examples are in docs/library.md.
 * A program that renders calls ubs_device_open, ubs_model_load, ubs_renderer_create and ubs_renderer_draw.
 * A program that trains calls ubs_device_open, ubs_data_open, ubs_trainer_create, ubs_trainer_run and
 * ubs_trainer_get_model.
 *
 * - Errors: functions that can fail return a ubs_status. If it is not UBS_OK, ubs_error_message() returns one
 *   line that says what is wrong and what to do. The function then leaves its outputs unchanged, with two
 *   exceptions: new handles are set to NULL, and an image may be incomplete if the device fails during
 *   copying.
 *
 * - Handles: handles from _create, _open, _load and _copy functions, and models and settings from _get
 *   functions, must be freed with the _free function of their type, which also accepts NULL. They can be
 *   freed in any order, because an object that was made from a handle keeps the data that it needs.
 *
 * - Memory: input arrays are copied before the function returns. Output arrays belong to the caller and must
 *   have the size that the function requires. Pointers into a handle are valid until the handle is freed.
 *
 * - Images: rows start at the top and are tightly packed. float: (height, width, 3), RGB, 0 to 1; alpha and
 *   depth (height, width).
 *
 * - World: right-handed; lengths are those of the data. Cameras have COLMAP's axes: x right, y down, z
 *   forward.
 *
 * - Structs begin with `size`. The caller must set it to sizeof before every call, so that later versions
 *   can add members at the end: ubs_camera camera = {sizeof camera}; the other members are then 0.
 *
 * - Threads: any thread may call any function. Calls that use the same device handle wait for each other;
 *   calls that use different device handles do not. A handle must not be used or freed while another thread
 *   changes it; a function changes the handles that it takes without `const`. Error messages are stored per
 *   thread.
 *
 * - Results: the same settings, data, device and build give bit-identical results, from C, from Python and
 *   from the executable.
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

/* Incremented when a function or struct changes in a way that requires programs to be recompiled. */
#define UBS_ABI_VERSION 1

/* The numbers are the exit codes of the executable. */
typedef enum ubs_status {
  UBS_OK = 0,
  UBS_ERROR_INTERNAL = 1,  /* a bug in ubs: please report */
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

/* UBS_ABI_VERSION and version ("0.2.0") of the loaded library. */
UBS_API uint32_t ubs_abi_version(void);
UBS_API const char* ubs_version(void);

/* Returns the error message of the last call in this thread that failed. Never NULL. The text is valid until
 * the next failure in this thread. */
UBS_API const char* ubs_error_message(void);

/* Receives log lines. Level 0 reports operations that take time, level 1 warnings. Only one thread at a time
 * calls the function, from inside of other calls; it must not throw. NULL: warnings go to stderr, as at the
 * start. Applies to the whole process. */
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
  uint64_t allocated_bytes, peak_bytes; /* of this handle; 0 for a device that is not open */
} ubs_device_info;

UBS_API ubs_status ubs_device_count(size_t* count);
/* Describes the device at `index` (less than the count), in the order of `ubs devices`. */
UBS_API ubs_status ubs_device_describe(size_t index, ubs_device_info* info);

/* Opens a device. `request`: "0" (an index), "cpu", "gpu", "cuda", "opencl", or a part of a name. NULL or "":
 * the environment variable UBS_DEVICE; if that is not set, the first GPU or, without a GPU, the first device.
 * A device may be opened several times. Before a device is used for a model variant for the first time, its
 * results are compared with float64. This is done once per device, driver and build, and takes seconds. It
 * gives UBS_ERROR_FAULTY if the device computes wrong results. UBS_CHECK=off in the environment disables the
 * comparison. */
UBS_API ubs_status ubs_device_open(const char* request, ubs_device** device);
UBS_API ubs_status ubs_device_get_info(const ubs_device* device, ubs_device_info* info);
UBS_API void ubs_device_free(ubs_device* device);

/* ---- Settings: by name, with the values of `ubs train --help` and YAML files ---- */

UBS_API ubs_status ubs_settings_create(ubs_settings** settings);
UBS_API ubs_status ubs_settings_copy(const ubs_settings* settings, ubs_settings** copy);
UBS_API void ubs_settings_free(ubs_settings* settings);
/* Loads settings from a YAML file. Settings that are not in the file keep their values. */
UBS_API ubs_status ubs_settings_load(ubs_settings* settings, const char* path);
/* Sets a value, for example "iterations" to "7000", or "background" to "1,1,1". Returns UBS_ERROR_USAGE for
 * unknown keys and for values out of range. */
UBS_API ubs_status ubs_settings_set(ubs_settings* settings, const char* key, const char* value);
/* Copies the value as text with its terminating 0, as far as it fits into `capacity` bytes. *length is set to
 * the length of the complete text without the 0. */
UBS_API ubs_status ubs_settings_get(const ubs_settings* settings, const char* key, char* value,
                                    size_t capacity, size_t* length);
/* Returns name and description of setting number `index`; both are NULL after the last setting. The pointers
 * stay valid. */
UBS_API ubs_status ubs_settings_describe(size_t index, const char** key, const char** help);

typedef enum ubs_use {
  UBS_USE_DATA = 0,     /* ubs_data_open */
  UBS_USE_MODEL = 1,    /* ubs_model_create */
  UBS_USE_RENDERER = 2, /* ubs_renderer_create */
  UBS_USE_TRAINER = 3   /* ubs_trainer_create, ubs_model_create_initial */
} ubs_use;

/* Returns UBS_ERROR_USAGE if a setting that was set or loaded has no effect on an object of this kind. The
 * functions that create objects ignore such settings, so that the same ubs_settings can be passed to all of
 * them. */
UBS_API ubs_status ubs_settings_check(const ubs_settings* settings, ubs_use use);

/* ---- Data: views with cameras and images, in the splits "train", "test" and "val" ---- */

typedef struct ubs_camera {
  size_t size;
  double world_to_camera[12]; /* (3, 4) row-major, rotation and translation: p_camera = R p_world + t */
  double fx, fy, cx, cy; /* focal lengths and principal point [px]; centre of the first pixel: (0.5, 0.5) */
  int32_t width, height; /* [px] */
  double time;           /* for models with time: 0 to 1 over the training views */
  uint32_t extra_count;  /* number of further query values for N = 5 and N >= 8, at most 4 */
  double extra[4];
} ubs_camera;

typedef struct ubs_view {
  size_t size;
  ubs_camera camera; /* the caller need not set its `size` */
  int32_t has_image, has_mask;
  char name[256];
} ubs_view;

/* Opens a folder of any known layout, or a packed file (docs/data.md). `settings` determine layout,
 * background, downscale, frames and so on; NULL: defaults. */
UBS_API ubs_status ubs_data_open(const char* path, const ubs_settings* settings, ubs_data** data);

/* A procedural scene, as `ubs synth` makes it. Members that are 0 have the defaults in brackets. */
typedef struct ubs_synthetic {
  size_t size;
  const char* scene;     /* "glossy" (static, reflections), "orbit" (dynamic), "cloud" (a volume) */
  int32_t width, height; /* [100] px */
  int32_t train_views;   /* [40] */
  int32_t test_views;    /* [8]; -1: none */
  int32_t val_views;     /* [0] */
  int32_t supersampling; /* [3] rays per pixel along each axis */
  uint64_t seed;         /* determines the cameras and the shape of the cloud */
  int32_t overwrite;     /* replace the files of an earlier scene in the folder */
} ubs_synthetic;

/* Writes a procedural scene into `folder`, which ubs_data_open can open. Equal members give equal files. */
UBS_API ubs_status ubs_data_synthesise(const ubs_synthetic* scene, const char* folder);
/* Creates an empty data set, to be filled by the next two functions. */
UBS_API ubs_status ubs_data_create(ubs_data** data);
UBS_API void ubs_data_free(ubs_data* data);
/* Appends a view. camera.time must lie between 0 and 1. `name`: unique in its split, and valid as a file name
 * without extension; NULL: the number of the view. `rgb`: (height, width, 3) bytes, already composited on the
 * background; NULL: a view without image. `mask`: (height, width) bytes, where 0 means that the pixel does
 * not count; or NULL. */
UBS_API ubs_status ubs_data_add_view(ubs_data* data, const char* split, const char* name,
                                     const ubs_camera* camera, const uint8_t* rgb, const uint8_t* mask);
/* Sets the points for initial models: positions (count, 3) in the world, colours (count, 3) or NULL. */
UBS_API ubs_status ubs_data_set_points(ubs_data* data, size_t count, const float* positions,
                                       const uint8_t* colours);
/* Sets *count to the number of views; 0 if the split does not exist. */
UBS_API ubs_status ubs_data_view_count(const ubs_data* data, const char* split, size_t* count);
UBS_API ubs_status ubs_data_get_view(const ubs_data* data, const char* split, size_t index, ubs_view* view);
/* Copies an image. rgb: (height, width, 3). mask: (height, width), 255 everywhere if the view has no mask; or
 * NULL. Returns UBS_ERROR_DATA for a view without image. */
UBS_API ubs_status ubs_data_get_image(const ubs_data* data, const char* split, size_t index, uint8_t* rgb,
                                      uint8_t* mask);

/* ---- Models: raw parameters in host memory ---- */

typedef struct ubs_model_info {
  size_t size;
  uint32_t dim;        /* N of the first group */
  uint32_t groups;     /* 1; more if the splats have different dimensions */
  uint64_t splats;     /* of all groups */
  uint64_t parameters; /* floats */
  double offset[3];    /* positions of splats are relative to the offset: world = xyz + offset */
  char form[256];      /* variant: "default", or the settings of docs/variants.md that differ from it */
} ubs_model_info;

typedef struct ubs_parameter {
  size_t size;
  /* "xyz", "rgb", "opacity", "beta", "mean", "scale", "l_triangle" and so on (docs/method.md 1.2). NULL if
   * there is no parameter of this number. */
  const char* name;
  uint32_t dim; /* N of the group */
  uint32_t rows;
  uint64_t splats;
  float* values; /* (rows, splats) row-major, inside of the model; may be read and written */
} ubs_parameter;

/* Creates a model of `splats` splats whose parameters are all 0. The settings determine its dimension ("dim"
 * must be a number) and variant. */
UBS_API ubs_status ubs_model_create(const ubs_settings* settings, uint64_t splats, ubs_model** model);
/* Creates the initial model of a training with these settings. Its splats are at the points of the data, or
 * at random positions if the data have no points. */
UBS_API ubs_status ubs_model_create_initial(const ubs_data* data, const ubs_settings* settings,
                                            ubs_model** model);
UBS_API ubs_status ubs_model_copy(const ubs_model* model, ubs_model** copy);
/* Creates a model of `splats` splats whose parameters are all 0, with everything else as in another model:
 * dimension, variant, offset, and the settings for rendering. */
UBS_API ubs_status ubs_model_create_like(const ubs_model* model, uint64_t splats, ubs_model** created);
UBS_API void ubs_model_free(ubs_model* model);
/* Loads a model file of any known format (docs/data.md), or the model in the folder of a finished run. */
UBS_API ubs_status ubs_model_load(const char* path, ubs_model** model);
/* Saves a model. `format` is a name of `ubs convert --to`. "ubs" or NULL saves everything. "auto" chooses the
 * format by the extension of the path, "ubs" for .ply; UBS_ERROR_USAGE if no format has the extension.
 * Formats other than "ubs" store the model at `time`, with directions averaged over the cameras that the
 * model lists, if any. Unlike `ubs convert`, the function does not fit the result to the model. Replaces an
 * existing file of that name, but neither a link nor a folder. */
UBS_API ubs_status ubs_model_save(const ubs_model* model, const char* path, const char* format, double time);
UBS_API ubs_status ubs_model_get_info(const ubs_model* model, ubs_model_info* info);
/* Returns parameter number `index` (from 0) of a group (less than the model's `groups`). */
UBS_API ubs_status ubs_model_get_parameter(ubs_model* model, uint32_t group, uint32_t index,
                                           ubs_parameter* parameter);
/* Returns the settings for rendering the model: the defaults, replaced by background, near and far plane,
 * blur and alpha_min as stored in its file, and by its dimension and variant. */
UBS_API ubs_status ubs_model_get_settings(const ubs_model* model, ubs_settings** settings);

/* ---- Renderers: a model on a device ---- */

/* Flags. With UBS_RENDER_ABSGRAD, each pixel counts by the absolute value of its contribution to the gradient
 * with respect to the position of a splat in the image, for x and y separately. ubs_renderer_vjp and
 * ubs_renderer_loss then compute the gradients of the positions of splats from these sums instead of the
 * gradient, and compute no gradient with respect to the camera. The sums are a criterion for densification
 * (AbsGS, Ye et al. 2024).
 * Requires UBS_RENDER_GRADIENTS. */
enum { UBS_RENDER_DEPTH = 1, UBS_RENDER_GRADIENTS = 2, UBS_RENDER_ABSGRAD = 4 };

typedef struct ubs_image {
  size_t size;
  float* rgb;   /* (height, width, 3), not clamped; NULL: not needed */
  float* alpha; /* (height, width); NULL: not needed */
  float* depth; /* (height, width), expected depth [world]; NULL: not needed. Requires UBS_RENDER_DEPTH */
  /* not 0: the renderer keeps the data that ubs_renderer_vjp needs to differentiate this image without
   * rendering it again. Requires UBS_RENDER_GRADIENTS */
  int32_t for_gradient;
} ubs_image;

typedef struct ubs_image_gradient {
  size_t size;
  const float* rgb;   /* (height, width, 3); NULL: 0 */
  const float* alpha; /* (height, width); NULL: 0 */
  const float* depth; /* (height, width); NULL: 0. Requires UBS_RENDER_DEPTH; no effect where alpha < 1e-6 */
} ubs_image_gradient;

/* Gradient with respect to a camera, for changes after which its rotation is still a rotation. */
typedef struct ubs_camera_gradient {
  size_t size;
  double pose[6]; /* for motions in the camera's frame: rotations about its axes [1/rad], then translations
                     along them: (R, t) -> (exp([w]) R, exp([w]) t + u) */
  double world_to_camera[12]; /* for the matrix, (3, 4), with the same restriction */
  double fx, fy, cx, cy, time;
  double extra[4];
} ubs_camera_gradient;

typedef struct ubs_loss {
  size_t size;
  double loss; /* (1 - lambda) l1 + lambda (1 - ssim) */
  double l1, ssim;
} ubs_loss;

/* Copies the model to the device. If `settings` is NULL, those of ubs_model_get_settings are used. `flags`
 * determines which operations the renderer supports. Gradients are those of the rendered image, including the
 * path through the view direction to the positions. Training ignores this path, as published. To ignore it
 * here too, set "query_grad" to "false". */
UBS_API ubs_status ubs_renderer_create(ubs_device* device, const ubs_model* model,
                                       const ubs_settings* settings, unsigned flags, ubs_renderer** renderer);
/* A falloff of splats that replaces (1 - r)^beta: the opacity is multiplied by 2^log2 where r < support. The
 * texts are expressions of r, the squared distance from the centre in units of the ellipse, and of the
 * splat's beta, in OpenCL C and CUDA C++ as in kernels/math, without blanks. Both are a vreal, and V(0.5) is a
 * number; operators are + - * / ?: and functions ubs_exp2, ubs_log, ubs_log2_1m (log2(1 - x)), ubs_sqrt,
 * ubs_sin and ubs_cos. The library compiles the texts unchanged for the device. */
typedef struct ubs_falloff {
  size_t size;
  const char* log2;
  const char* r_slope;    /* the derivative of log2 with respect to r */
  const char* beta_slope; /* and with respect to beta */
  float support;          /* above 0, at most 100 */
} ubs_falloff;

/* Like ubs_renderer_create, with a falloff of the program's own (NULL: that of the model), for models of the
 * kernel "beta". Returns UBS_ERROR_BUILD if the device's compiler does not accept an expression. The library
 * does not compare the results with float64; the Python package does. */
UBS_API ubs_status ubs_renderer_create_falloff(ubs_device* device, const ubs_model* model,
                                               const ubs_settings* settings, unsigned flags,
                                               const ubs_falloff* falloff, ubs_renderer** renderer);
UBS_API void ubs_renderer_free(ubs_renderer* renderer);
/* Replaces the parameter values by those of another model, which must have the same groups, dimensions and
 * variant, and at most as many splats. */
UBS_API ubs_status ubs_renderer_update(ubs_renderer* renderer, const ubs_model* model);
UBS_API ubs_status ubs_renderer_draw(ubs_renderer* renderer, const ubs_camera* camera,
                                     const ubs_image* image);
/* Vector-Jacobian product. Renders the view and converts the gradient of a scalar with respect to its pixels
 * to the gradient with respect to every raw parameter. `gradient` receives it: a model of the same structure,
 * for example from ubs_model_copy, whose values are replaced. With NULL only the gradient with respect to the
 * camera is computed. Requires UBS_RENDER_GRADIENTS.
 * If `camera` is NULL, the function differentiates the image that was rendered last, and does not render it
 * again. This image must have been rendered with for_gradient or by this function. The result is
 * UBS_ERROR_USAGE if there is no such image, or if one of the following has happened since: gradients of
 * alpha or depth were computed, the parameters were replaced, or their array was requested. */
UBS_API ubs_status ubs_renderer_vjp(ubs_renderer* renderer, const ubs_camera* camera,
                                    const ubs_image_gradient* v_image, ubs_model* gradient);
/* Computes the training loss against `target` (height, width, 3), where 1 - SSIM has the weight lambda_dssim.
 * `gradient` receives its gradient without regularisers, like in ubs_renderer_vjp (NULL: only the loss is
 * computed). `mask`: (height, width) bytes, where 0 means that the pixel does not count; or NULL. */
UBS_API ubs_status ubs_renderer_loss(ubs_renderer* renderer, const ubs_camera* camera, const float* target,
                                     const uint8_t* mask, float lambda_dssim, ubs_loss* loss,
                                     ubs_model* gradient);

/* Returns the gradient with respect to the camera that belongs to the last call of ubs_renderer_vjp or
 * ubs_renderer_loss with gradients. It includes the effect of the view direction on the splats, whatever
 * "query_grad" is. Returns UBS_ERROR_USAGE if the background is a sky of harmonics. */
UBS_API ubs_status ubs_renderer_camera_gradient(ubs_renderer* renderer, ubs_camera_gradient* gradient);

/* Arrays of a renderer in the memory of its device, for programs that compute on the same device. Available
 * on CUDA devices and on CPUs with PoCL; other devices return UBS_ERROR_USAGE, because their OpenCL provides
 * no addresses. */
typedef enum ubs_array_name {
  UBS_ARRAY_PARAMETERS = 0, /* (rows, splats), rows in the order of ubs_model_get_parameter; may be written */
  UBS_ARRAY_RGB = 1, /* (height, width, 3), last rendered image; not available after v_image.alpha or depth */
  UBS_ARRAY_TRANSMITTANCE = 2, /* (height, width): 1 - alpha */
  UBS_ARRAY_DEPTH = 3,         /* (height, width) */
  UBS_ARRAY_V_RGB = 4,   /* zeros; the caller sets height and width as the first two entries of `shape`. Write
                            a gradient to it and pass it to ubs_renderer_vjp as rgb, without alpha */
  UBS_ARRAY_GRADIENT = 5, /* like the parameters: the last gradient that the renderer computed */
  UBS_ARRAY_EXTENTS = 6,  /* (splats, 2): half the width and height [px] of the rectangle around the ellipse of each
                             splat in the last image; undefined for splats outside of the near and far planes */
  UBS_ARRAY_V_MEANS2D = 7 /* (splats, 2): the last gradient with respect to the position of each splat in the image
                             [1/px], or the sums of UBS_RENDER_ABSGRAD. May be written: UBS_ARRAY_GRADIENT and
                             ubs_renderer_camera_gradient are then computed from the written values */
} ubs_array_name;

typedef struct ubs_array {
  size_t size;
  float* values;         /* an address on the device */
  int32_t type, ordinal; /* device in the terms of DLPack: 2 and the CUDA device number; 1 and 0 for a CPU */
  int32_t dims;
  int64_t shape[3], strides[3]; /* [floats] */
} ubs_array;

/* Returns an array after waiting for the renderer. The program must have finished using the array before its
 * next call that uses this device. The array is valid until the renderer renders a view of another size or gets
 * another model. `group` is the number of a group of splats, for arrays with an entry per splat. */
UBS_API ubs_status ubs_renderer_get_array(ubs_renderer* renderer, ubs_array_name name, uint32_t group,
                                          ubs_array* array);

/* ---- Training ---- */

typedef struct ubs_step {
  size_t size;
  uint32_t iteration, iterations; /* finished iterations, total */
  double seconds;                 /* training time so far */
  uint64_t splats;
  double loss;                 /* mean since the last value; NaN if not computed (setting log_every) */
  double test_psnr, test_ssim; /* NaN in iterations without evaluation (eval_every, and the last) */
} ubs_step;

typedef struct ubs_metrics {
  size_t size;
  double psnr;       /* [dB], mean over the channels of 10 log10(1 / mse), as in published code */
  double psnr_joint; /* from the mean squared error of all channels [dB] */
  double ssim;       /* 11 x 11 Gaussian, zero-padded */
  double ssim_valid; /* over the windows inside of the image; NaN if there is none */
  /* NaN for networks that were not requested. The networks get 2 v - 1, or v for the names with _unit, as
   * in published evaluations of splats. */
  double lpips_alex, lpips_squeeze, lpips_vgg;
  double lpips_alex_unit, lpips_squeeze_unit, lpips_vgg_unit;
} ubs_metrics;

/* Called after every iteration. Returning 0 stops the run. It may use other handles and read the trainer. */
typedef int (*ubs_step_function)(void* user, const ubs_step* step);

/* Creates a trainer with settings of `ubs train` (NULL: defaults). Settings that determine how data are read
 * must have the values that `data` was opened with. `initial`: a model of the settings' dimension and
 * variant; NULL: the one that ubs_model_create_initial() makes. */
UBS_API ubs_status ubs_trainer_create(ubs_device* device, const ubs_data* data, const ubs_settings* settings,
                                      const ubs_model* initial, ubs_trainer** trainer);
UBS_API void ubs_trainer_free(ubs_trainer* trainer);
/* Trains for `steps` iterations, or to the end if `steps` is 0 or larger than the number of remaining
 * iterations. `function` may be NULL. After an error the trainer has the state of the last complete
 * iteration, if there is one. */
UBS_API ubs_status ubs_trainer_run(ubs_trainer* trainer, uint32_t steps, ubs_step_function function,
                                   void* user);
/* Returns the current progress; loss and metrics are NaN. */
UBS_API ubs_status ubs_trainer_get_status(const ubs_trainer* trainer, ubs_step* step);
/* Returns the current model. */
UBS_API ubs_status ubs_trainer_get_model(const ubs_trainer* trainer, ubs_model** model);
/* Replaces the splats in training, for example to add or remove some, and keeps everything else: the
 * iteration, cameras, appearance, background. `model`: of the trainer's dimension and variant, with at most
 * as many splats as the trainer has room for (the larger of cap_max and the splats of the initial model).
 * `from`: for each splat, the index of the current splat whose optimiser state it takes over, or -1 for a new
 * state; NULL: all states are new. */
UBS_API ubs_status ubs_trainer_set_model(ubs_trainer* trainer, const ubs_model* model, const int64_t* from);
/* Returns the mean metrics over the test views. Returns UBS_ERROR_DATA if there are none. */
UBS_API ubs_status ubs_trainer_evaluate(ubs_trainer* trainer, ubs_metrics* metrics);
/* Write a checkpoint, and resume from one. The trainer must have been created with the same data, settings
 * and device; otherwise UBS_ERROR_USAGE or UBS_ERROR_DATA names what differs. The result is bit-identical to
 * that of an uninterrupted training. */
UBS_API ubs_status ubs_trainer_save(const ubs_trainer* trainer, const char* path);
UBS_API ubs_status ubs_trainer_restore(ubs_trainer* trainer, const char* path);

/* ---- Comparing images ---- */

/* `networks`: LPIPS networks, such as "alex,squeeze,vgg"; NULL or "": none. `weights`: a safetensors file, or
 * a folder with lpips_NAME.safetensors (docs/metrics.md); NULL: the environment variable
 * UBS_LPIPS_WEIGHTS. */
UBS_API ubs_status ubs_meter_create(ubs_device* device, const char* networks, const char* weights,
                                    ubs_meter** meter);
UBS_API void ubs_meter_free(ubs_meter* meter);
/* Compares two images of size (height, width, 3), clamped to 0 to 1. */
UBS_API ubs_status ubs_meter_compare(ubs_meter* meter, int32_t width, int32_t height, const float* truth,
                                     const float* image, ubs_metrics* metrics);

#ifdef __cplusplus
}
#endif

#endif /* UBS_UBS_H */
