// SPDX-License-Identifier: Apache-2.0
// Number of parameters of a learnt sky. It has a coefficient for each of nine spherical harmonics and three channels.
#define SKY_NUMBERS 27
