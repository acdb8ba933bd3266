// Of the solver, what forces need.
// Multipliers of the rows that hold what pushes along the unknowns: the smallest, refined.
const held = (q, c, pushes) => {
  const out = zeros(m), x = zeros(n);
  if (!look(q, c, false, out)) return null;
  for (let pass = 0; pass < 3; pass++) {
    for (let j = 0; j < n; j++) {
      x[j] = pushes[j];
      for (let i = 0; i < m; i++) x[j] -= A[i * n + j] * out[i];
      x[j] /= L.weights[j];
      for (let i = 0; i < j; i++) x[j] -= W[i * width + j] * x[i];
      x[j] /= W[j * width + j];
    }
    for (let j = n - 1; j >= 0; j--) {
      for (let i = j + 1; i < n; i++) x[j] -= W[j * width + i] * x[i];
      x[j] /= W[j * width + j];
    }
    for (let i = 0; i < m; i++) for (let j = 0; j < n; j++) out[i] += A[i * n + j] / L.weights[j] * x[j];
  }
  return out;
};
const holding = { held };
