// Forces: those of the motion as it was given; those of other poses and dimensions where the page finds them.
let forced = true;
const known = () => handled?.exerts() || k < D.poses && !handled?.altered(), acting = () => forced && known();
const note = el("span"), switched = $("forces").parentNode;
told = () => { note.textContent = known() ? "" : `(${D.unforced || "not determined here"})`; };
switched.append(note);
switched.hidden = !D.arrows.some(set => set.order > 1);
on($("forces"), "change", event => { forced = event.target.checked; show(k); });
