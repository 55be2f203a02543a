// SPDX-License-Identifier: Apache-2.0
// Numbers of a sky: nine functions of the direction, three channels.
#define SKY_NUMBERS 27
