#include "compute_capsule_local.h"

#include "pair_capsule.h"

#include "atom.h"
#include "error.h"
#include "force.h"
#include "update.h"

#include <cmath>

using namespace LAMMPS_NS;
using namespace cgfibre;

ComputeCapsuleLocal::ComputeCapsuleLocal(LAMMPS *lmp, int narg, char **arg) : Compute(lmp, narg, arg)
{
  if (narg != 3) error->all(FLERR, "compute capsule/local takes no words");
  local_flag = 1;
  size_local_cols = COLUMNS;
  size_local_rows = 0;
}

void ComputeCapsuleLocal::init()
{
  if (!dynamic_cast<PairCapsule *>(force->pair)) error->all(FLERR, "compute capsule/local needs pair_style capsule");
}

void ComputeCapsuleLocal::compute_local()
{
  invoked_local = update->ntimestep;
  auto *pair = dynamic_cast<PairCapsule *>(force->pair);
  if (!pair) error->all(FLERR, "compute capsule/local needs pair_style capsule");
  contacts.clear();
  pair->for_contacts([&](int a, int b, const CapsuleContact &c) {
    if (!(atom->mask[a] & groupbit) && !(atom->mask[b] & groupbit)) return;
    std::array<double, COLUMNS> row{(double) atom->tag[a], (double) atom->tag[b], (double) atom->molecule[a],
                                    (double) atom->molecule[b], c.normal};
    for (int d = 0; d < 3; d++) {
      row[5 + d] = c.friction[d];
      row[8 + d] = c.force[d];
      row[11 + d] = c.point[d];
    }
    row[14] = c.length;
    row[15] = c.distance;
    row[16] = c.angle();
    row[17] = c.energy;
    row[18] = c.slipping ? 1.0 : 0.0;
    contacts.push_back(row);
  });
  lines.clear();
  for (auto &row : contacts) lines.push_back(row.data());
  size_local_rows = (int) contacts.size();
  array_local = lines.data();
}

double ComputeCapsuleLocal::memory_usage()
{
  return (double) contacts.capacity() * sizeof(contacts[0]) + (double) lines.capacity() * sizeof(double *);
}
