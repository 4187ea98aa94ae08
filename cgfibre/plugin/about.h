// command "cgfibre_plugin": says in the log which sources serve the run, and that all ranks have them.
#ifndef CGFIBRE_ABOUT_H
#define CGFIBRE_ABOUT_H

#include "command.h"

namespace cgfibre {

class About : public LAMMPS_NS::Command {
 public:
  About(LAMMPS_NS::LAMMPS *lmp) : Command(lmp) {}
  void command(int, char **) override;
};

}    // namespace cgfibre

#endif
