// Follows a mechanism by its equations F from the pose in L: Newton's method in steps that keep the branch.
// The numbers that say so are those of jaxnc/solvers/branch.py.
const zeros = count => new Float64Array(count), largest = x => max(0, ...x.map(abs));
const solver = (F, L) => {
  const each = f => L.unknown.forEach(f);
  const n = L.unknown.length, m = L.rows, driven = L.driven.length, width = n + 1 + driven;
  const A = zeros(m * n), B = zeros(m * driven), R = zeros(m), G = zeros(L.guards);
  const W = zeros(m * width), close = {{CLOSE}} * L.length, hits = new Int32Array(m), solved = zeros(n);
  // Slopes T of the unknowns (as lengths) by the inputs, the step of Newton S, and on which side of a fold the pose lies.
  const look = (q, c, tangent, right) => {
    A.fill(0); F.matrix(q, c, A); B.fill(0); F.driven(q, c, B);
    for (let i = 0; i < m; i++) {
      for (let j = 0; j < n; j++) W[i * width + j] = A[i * n + j] / L.weights[j];
      W[i * width + n] = right[i];
      for (let j = 0; j < driven; j++) W[i * width + n + 1 + j] = B[i * driven + j];
    }
    let sign = 1, least = Infinity, most = 0;
    for (let j = 0; j < n; j++) {
      let square = 0, count = 0;
      for (let i = j; i < m; i++) { const x = W[i * width + j]; if (x) { square += x * x; hits[count++] = i; } }
      const size = sqrt(square), x0 = W[j * width + j], pivot = x0 > 0 ? -size : size;
      if (!(size > 0)) return null;
      if (hits[0] !== j) { hits.copyWithin(1, 0, count++); hits[0] = j; }
      const share = 1 / (size * (size + abs(x0)));
      W[j * width + j] = x0 - pivot;
      for (let l = j + 1; l < width; l++) {
        let along = 0;
        for (let h = 0; h < count; h++) along += W[hits[h] * width + j] * W[hits[h] * width + l];
        if (along) { along *= share; for (let h = 0; h < count; h++) W[hits[h] * width + l] -= along * W[hits[h] * width + j]; }
      }
      W[j * width + j] = pivot;
      sign *= pivot > 0 ? -1 : 1; least = min(least, size); most = max(most, size);
    }
    if (!(least > 1e-13 * most)) return null;
    const T = tangent ? zeros(n * driven) : null;
    for (let l = n; l < (tangent ? width : n + 1); l++) for (let j = n - 1; j >= 0; j--) {
      let x = W[j * width + l];
      for (let i = j + 1; i < n; i++) x -= W[j * width + i] * (l === n ? solved[i] : -T[i * driven + l - n - 1]);
      x /= W[j * width + j];
      if (l === n) solved[j] = x; else T[j * driven + l - n - 1] = -x;
    }
    return { sign, T, step: solved };
  };
  const residual = (q, c) => { F.rows(q, c, R); return largest(R); };
  // Newton's method, and a step beyond; how far the unknowns moved, or NaN.
  const correct = (q, c, most = 12) => {
    const enough = {{ACCEPT}} * L.length + {{ROUNDING}} * largest(q), from = q.slice();
    let size = residual(q, c), good = size <= enough;
    for (let turn = 0; turn < most && size > 0; turn++) {
      if (!(size < 1e200)) return NaN;
      const found = look(q, c, false, R);
      if (!found) return good ? 0 : NaN;
      const kept = q.slice();
      each((u, j) => { q[u] -= found.step[j] / L.weights[j]; });
      const next = residual(q, c);
      if (good && !(next < size)) { q.set(kept); break; }
      if (good) { size = next; break; }
      size = next; good = size <= enough;
    }
    return good ? length(L.unknown.map((u, j) => (q[u] - from[u]) * L.weights[j])) : NaN;
  };
  const upright = (q, c) => { F.guards(q, c, G); return G.every(g => g > 0); };
  const length = x => hypot(...x);
  const along = (T, way) => { const out = zeros(n); for (let j = 0; j < n; j++) for (let k = 0; k < driven; k++) out[j] += T[j * driven + k] * way[k]; return out; };
  // Inputs are led to a target; q becomes the last pose on the way. Whether it is reached.
  const follow = (q, c, target) => {
    const from = L.driven.map(k => q[k]), way = target.map((x, k) => x - from[k]);
    const turn = max(0, ...way.map((x, k) => L.angles[k] ? abs(x) : 0)), input = length(way.map((x, k) => L.angles[k] ? 0 : x));
    if (!way.some(x => x)) return correct(q, c) >= 0;
    residual(q, c);
    let here = look(q, c, true, R), done = 0, part = min(1, {{TURN}} / turn, {{FIRST}} * L.length / input), least = {{SHORTEST}} * part;
    if (!here) return false;
    for (let left = {{STEPS}} / part; done < 1; left--) {
      part = min(part, 1 - done);
      const p = q.slice(), to = done + part > 1 - 1e-12 ? 1 : done + part, speed = along(here.T, way);
      L.driven.forEach((k, i) => { p[k] = to === 1 ? target[i] : from[i] + way[i] * to; });
      each((u, j) => { p[u] += part * speed[j] / L.weights[j]; });
      const expected = part * length(speed), moved = correct(p, c, 8);
      let there = moved <= {{SHARP}} * expected + close && upright(p, c) && look(p, c, true, R);
      if (there) {
        const after = along(there.T, way), bend = part * length(after.map((x, j) => x - speed[j]));
        const folded = n === m && there.sign !== here.sign && expected > {{CROSSING}} * L.length;
        if (folded || bend > {{SHARP}} * (expected + part * length(after)) + close) there = null;
      }
      if (there) { q.set(p); here = there; done = to; part *= 2; } else part /= 2;
      // Beside a dead point the first steps away from it are shorter still.
      if (left < 0 || !there && part < least * (done ? 1 : 1e-4)) return false;
    }
    return true;
  };
  // Slopes of the unknowns (as lengths) by the inputs; and how far the fastest goes, without end at a dead point.
  const slopes = (q, c) => { residual(q, c); return look(q, c, true, R)?.T; }, swift = (q, c) => { const T = slopes(q, c); return T ? max(...T.map(abs)) : Infinity; };
  // Velocities and accelerations of all coordinates from those of the inputs.
  const rates = (q, c, speeds) => {
    residual(q, c);
    const found = look(q, c, true, R), zero = zeros(m);
    if (!found) return null;
    const spread = (given, way) => { const out = zeros(q.length); L.driven.forEach((k, i) => { out[k] = given[i]; }); if (way) each((u, j) => { out[u] = way[j] / L.weights[j]; }); return out; };
    const v = spread(speeds[0], along(found.T, speeds[0]));
    if (speeds.length < 2 || !F.second) return [v];
    F.second(q, c, v, spread(speeds[1]), zero);
    return [v, spread(speeds[1], look(q, c, false, zero).step.map(x => -x))];
  };
{{HOLDING}}
{{MORPHING}}
  return { follow, slopes, swift, rates, correct, morph, ...holding };
};
