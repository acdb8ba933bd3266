let fit=()=>{},grips=fit,stretch=fit;
let drawing=()=>{let q=now.q.slice();return S.follow(q,now.c,L.home)?q:null};
