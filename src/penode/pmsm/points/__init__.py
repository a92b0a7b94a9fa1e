"""Machines from tables of operating points: voltages, currents, speed and torque at rest."""
