const last=Math.max(...films.map(f=>f.frames.length))-1,slider=document.getElementById('at'),button=document.getElementById('play');
slider.max=last;let now=Math.min(last,Math.round(+(location.hash.slice(1)||0)*rate)),playing=!location.hash;
function show(){films.forEach((f,i)=>{const k=Math.min(now,f.frames.length-1);
document.getElementById('f'+i).src=f.frames[k];document.getElementById('p'+i).textContent=f.words[k];
document.querySelectorAll('#n'+i+' li').forEach(l=>l.classList.toggle('said',+l.dataset.t<=f.times[k]+.05))});slider.value=now}
setInterval(()=>{if(playing){now=now>=last+rate*2?0:now+1;show()}},1000/rate);
slider.oninput=()=>{now=+slider.value;playing=false;button.textContent='Play';show()};
button.onclick=()=>{playing=!playing;button.textContent=playing?'Pause':'Play'};button.textContent=playing?'Pause':'Play';show();
