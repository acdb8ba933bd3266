const F = {{EQUATIONS}};
{{SOLVER}}
handled = (() => { const L = D.live;
{{HANDLING}}
})();
