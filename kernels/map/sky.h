// SPDX-License-Identifier: Apache-2.0
// Size of a sky: nine functions of the direction for each of three channels.
#define SKY_NUMBERS 27
