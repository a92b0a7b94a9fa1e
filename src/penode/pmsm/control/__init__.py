"""Control loci: MTPA, MTPV and torque over speed."""
