// A motion in time plays by the clock; what does not come back to where it began ends.
let moment = 0;
function begin() {
  if (!D.closed && nearest === last) show(0);
  moment = D.time[nearest];
}
function timed(now) {
  const span = D.time[last] - D.time[0];
  moment += max(0, now - clock) * D.pace * speed(); clock = max(clock, now);
  if (moment >= D.time[last] && D.closed) moment -= span * floor((moment - D.time[0]) / span);
  let next = moment < D.time[nearest] ? 0 : nearest;
  while (next < last && D.time[next + 1] <= moment) next++;
  if (next !== nearest) show(next);
  if (next === last && !D.closed) return pause();
  raf(tick);
}
if (D.pace !== 1) for (const option of $("speed").options) { const factor = option.value * D.pace; option.textContent = factor < 1 ? `1/${round(1 / factor)}×` : `${factor}×`; }
