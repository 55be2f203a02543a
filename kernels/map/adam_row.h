// SPDX-License-Identifier: Apache-2.0
// The functions of this file load and store the Adam state of one parameter of UBS_VW splats. adam.cl and learn.cl use
// them.

UBS_FN AdamState adam_load(vreal param, UBS_GLOBAL const real* moment1, UBS_GLOBAL const real* moment2) {
  AdamState s;
  s.param = param;
  s.moment1 = UBS_LOAD(moment1);
  s.moment2 = UBS_LOAD(moment2);
  return s;
}

UBS_FN void adam_store(AdamState s, UBS_GLOBAL real* param, UBS_GLOBAL real* moment1, UBS_GLOBAL real* moment2) {
  UBS_STORE(s.param, param);
  UBS_STORE(s.moment1, moment1);
  UBS_STORE(s.moment2, moment2);
}
