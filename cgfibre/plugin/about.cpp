#include "about.h"

#include "guard.h"

#include "comm.h"
#include "error.h"
#include "utils.h"

using namespace LAMMPS_NS;

namespace cgfibre {

void About::command(int narg, char **)
{
  if (narg != 0) error->all(FLERR, "cgfibre_plugin takes no words");
  int one = 1, ranks = 0;
  MPI_Allreduce(&one, &ranks, 1, MPI_INT, MPI_SUM, world);
  if (comm->me == 0)
    utils::logmesg(lmp, "cgfibre plugin: sources {}, built for LAMMPS {} with {}, on {} of {} ranks\n", CGFIBRE_SOURCES,
                   CGFIBRE_LAMMPS_VERSION, mpi_here(), ranks, comm->nprocs);
}

}    // namespace cgfibre
