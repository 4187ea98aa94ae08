#ifndef CGFIBRE_TABLES_H
#define CGFIBRE_TABLES_H

#include "lammpsplugin.h"

namespace cgfibre {

// pair granular/table, fix wall/granular/table and fix CGFIBRE/HISTORY; `stem` has version, author and handle
void enrol_tables(const lammpsplugin_t &stem, lammpsplugin_regfunc enrol, void *lmp);

}    // namespace cgfibre

#endif
