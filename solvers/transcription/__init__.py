"""Direct transcriptions: each turns an optimal-control problem into a nonlinear program on a mesh."""
