// The few operations on three components that the styles share.

#ifndef CGFIBRE_VECTOR3_H
#define CGFIBRE_VECTOR3_H

namespace cgfibre {

inline double dot(const double *a, const double *b)
{
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline void cross(const double *a, const double *b, double *c)
{
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

}    // namespace cgfibre

#endif
