"""Any number of shots to pictures: what is done already, who makes what, in how many processes, on how many machines."""
