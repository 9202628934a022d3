"""Grammar of questions and sentences of answers in English, German, French and Spanish.

Each language lists words by class. A class is a role in a question: an interrogative (``why``, ``who``), a verb that
every agent knows (``see``, ``do``), a reference (``me``, ``people``), a tense or a negation. Words have no accents.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

INTERROGATIVES = ("why", "what", "who", "when", "how_often", "how_many", "unanswerable")


@dataclass(frozen=True)
class Language:
    """Words by class, and sentences of answers by name."""

    code: str
    words: Mapping[str, str]
    """Alternatives, separated by commas; an alternative may have several words."""
    sentences: Mapping[str, str]

    @cached_property
    def phrases(self) -> dict[str, tuple[tuple[str, ...], ...]]:
        """Alternatives of each class as tuples of words."""
        return {name: tuple(tuple(one.split()) for one in text.split(",")) for name, text in self.words.items()}


ENGLISH = Language(
    "en",
    {
        "why": (
            "how is it that,how was it that,motive,motivation,purpose,justification,why,what made,what makes,"
            "what brought,how come,for what reason,what reason,what was the reason,what is the reason,reason,"
            "what for,what made you,what makes you,made you,what caused,cause,what led,led you to,what prompted,"
            "prompted you,motivated,explain,on what grounds,what brought you to,justify,account for"
        ),
        "what": "what,which thing,anything,describe,something",
        "who": (
            "who,list,name,enumerate,whom,which people,which person,which persons,which visitors,which of you,"
            "which agent,which robot"
        ),
        "when": (
            "when,at what time,what time,at which time,which time,at what moment,at what point,what moment,since when"
        ),
        "how_often": (
            "how often,how many times,number of times,how frequently,count how often,how many time,many times"
        ),
        "how_many": "how many,number of,count",
        "unanswerable": (
            "where,how long,how much,how far,how old,which colour,which color,what colour,what color,whose,how fast,"
            "how tall,how do,how did,how are,how can,how was,how is,how will,how big,what is your name,how"
        ),
        "not": (
            "nothing,nobody,no one,not,never,no,without,refuse,refused,fail to,failed to,forget to,forgot to,omit,"
            "skip,avoid,neither,stop you from,stopped you from,keep you from,kept you from,prevented you from,"
            "instead of"
        ),
        "see": (
            "see,look like,notice,observe,in view,in sight,in front of,visible,perceive,sense,detect,spot anybody,"
            "watching,recognise,your camera,camera show,looking at,ahead of you,before your eyes,your view"
        ),
        "do": "do,doing,up to,busy with,working on,act,action,actions,perform,occupied,task,job,activity,deed",
        "happen": "happen,going on,occur,went on",
        "next": "next,then,afterwards,after that,after this,now on,future,upcoming,following step,soon",
        "plan": (
            "plan to,planning,intend,intention,intentions,going to,will you,want,goal,goals,aim,desire,plans,"
            "your plan,are you about,about to,trying to,shall you,aiming"
        ),
        "say": "say,speak,tell,utter,words,talk",
        "here": (
            "here,come,came,visit,visited,arrive,there,around,show up,showed up,turn up,turned up,present,pass by,"
            "walk by,drop by,stop by,enter,appear,leave,left"
        ),
        "people": (
            "people,person,persons,visitor,visitors,man,woman,guest,guests,human,humans,guy,lady,child,men,women,"
            "anybody,anyone,somebody,someone,everybody,one,faces"
        ),
        "nobody": "nobody,no one,noone",
        "me": "me,i,my,myself,us,we,mine",
        "you": "you,your,yourself,waldo,robot,u,ya,ye",
        "them": "him,her,them,they,he,she,that person,this person,that man,that woman,that visitor,it",
        "past": (
            "came,visited,arrived,appeared,saw,did,was,were,have,has,had,been,just,yet,already,so far,until now,ago,"
            "earlier,before,done"
        ),
        "future": "will,shall,going to,next,would",
        "present": "are,is,do,does,can,am,now,currently,right now,at the moment,could",
        "ago": "ago,earlier",
        "first": "first,at first",
        "last": "last,latest,most recent,previous,recent",
        "ordinals": "second,third,fourth,fifth,sixth,seventh,eighth,ninth,tenth",
        "time": "time,times",
        "seconds": "s,sec,secs,second,seconds",
        "minutes": "min,mins,minute,minutes",
        "at": "at,around,about,after,in,from,during,by",
        "start": "at the start,at the beginning,in the beginning,initially,to begin with",
        "recently": "just now,right now,a moment ago,just,lately,now",
        "filler": (
            "behind,right,correct,used,use,keep,kept,stay,stayed,remain,remained,picture,image,scene,my,his,her,"
            "their,its,very,quite,altogether,get,got,receive,received,give,gave,given,given to,away,back,off,out,"
            "over,into,onto,inside,toward,towards,please,hey,hi,okay,ok,well,so,tell me,can you tell me,"
            "could you tell me,i would like to know,i want to know,do you know,let me know,would you say,"
            "could you say,can you say,the,a,an,of,to,for,that,this,on,with,and,any,kind,by,it,from,as,ever,even,"
            "really,then,actually,in,at,be,being,like,earth,hell,up,your,want to,decide to,decided to,choose to,"
            "chose to,have to,had to,need to,started to,start,begin,began,some,all,exactly,precisely,there,here,if,"
            "whether,or,but,run,recording,video,during,during the run,total,altogether,together,please tell,time,"
            "whole,again,once,twice,too,also,still,only,thing,things,these,those,such,own,so far,way"
        ),
    },
    {
        "because": " because",
        "and": "and",
        "at": "at {at} s",
        "ago": "{ago} seconds ago",
        "just_now": "just now",
        "then": "{when} {clause}",
        "person": "person {id}",
        "somebody": "somebody",
        "anybody": "anybody",
        "yes": "Yes",
        "no": "No",
        "unknown": "I don't know",
        "unclear": "I am not sure what you ask",
        "not_recorded": "the record does not say so",
        "belief": "I believed {what}",
        "no_belief": "I did not believe {what}",
        "saw_none": "I saw nobody",
        "saw_one": "I saw {people}",
        "away": "{person} {distance} m away",
        "nobody_came": "nobody was here",
        "here": "{person} was here from {at} to {until} s",
        "here_you": "you were here from {at} to {until} s",
        "counted": "{count} people were here",
        "counted_one": "one person was here",
        "times": "{count} times",
        "times_one": "once",
        "said": 'I said "{what}"',
        "said_nothing": "I said nothing",
        "nothing_next": "I had no intention",
        "next_was": "the next thing was {when}: {clause}",
        "last_was": "the last thing was {when}: {clause}",
        "nothing_done": "I was doing nothing",
        "wanted": "I wanted {what}",
        "assumes": "I take you for person {id}.",
        "examples": (
            "Why did you {deed}? | What do you see? | What will you do next? | Who was here? | When did you {deed}? "
            "| How often did you {deed}? | Did you {deed}? | What did you do at {at} seconds?"
        ),
    },
)

GERMAN = Language(
    "de",
    {
        "why": (
            "warum,wieso,weshalb,weswegen,aus welchem grund,welchen grund,was war der grund,grund,wozu,erklare,"
            "wie kommt es,was brachte dich dazu,was hat dich dazu gebracht,was hat dich veranlasst"
        ),
        "what": "was,irgendwas,etwas,beschreibe",
        "who": "wer,wen,wem,welche leute,welche person,welche personen,welche besucher,welcher roboter,welcher agent",
        "when": "wann,um welche zeit,zu welcher zeit,zu welchem zeitpunkt,seit wann",
        "how_often": "wie oft,wie haufig,wie viele male,wieviele male,wie viel mal,wie viele mal",
        "how_many": "wie viele,wieviele,wie viel,anzahl",
        "unanswerable": (
            "wo,wohin,woher,wie lange,wie weit,wie alt,welche farbe,wessen,wie heisst,wie schnell,wie gross,wie"
        ),
        "not": "nicht,nie,niemals,kein,keine,keinen,keiner,vergessen,versaumt,unterlassen",
        "see": (
            "siehst,sehen,gesehen,sahst,sieht,sah,erkennst,erkannt,bemerkt,bemerkst,im blick,vor dir,sichtbar,"
            "wahrgenommen,beobachtest,beobachtet,kamera"
        ),
        "do": "tust,machst,tun,getan,gemacht,tat,machte,tatest,macht,beschaftigt,treibst,tut,unternommen",
        "happen": "passiert,geschehen,geschieht,passierte,geschah,los",
        "next": "als nachstes,nachstes,danach,dann,nachste,anschliessend,gleich",
        "plan": "planst,vor,vorhast,willst,wirst,ziel,absicht,plan,plane,ziele,mochtest,beabsichtigst",
        "say": "sagst,gesagt,sagen,sagtest,gesprochen,sagte",
        "here": "hier,da,gekommen,kam,kamen,besucht,anwesend,vorbei,vorbeigekommen,aufgetaucht,dort,gegangen",
        "people": (
            "leute,person,personen,besucher,besucherin,mann,frau,gast,gaste,mensch,menschen,jemand,jemanden,kind"
        ),
        "nobody": "niemand,niemanden",
        "me": "mich,mir,ich,uns,wir",
        "you": "du,dich,dir,waldo,roboter,ihr",
        "them": "ihn,ihm,sie,ihnen,er,diesen mann,diese frau",
        "past": (
            "kam,kamen,gekommen,sah,sahst,hast,habe,hat,haben,hattest,war,waren,wart,wurde,wurden,wurdest,bist,"
            "gerade,eben,schon,vorher,bisher"
        ),
        "future": "wirst,werden,als nachstes,nachstes,vorhast",
        "present": "ist,sind,kannst,jetzt,gerade,derzeit,momentan,siehst,machst,tust",
        "ago": "vor",
        "first": "erste,ersten,erster,erstes,zuerst,erstmals",
        "last": "letzte,letzten,letzter,letztes,zuletzt,vorige",
        "ordinals": "zweite,dritte,vierte,funfte,sechste,siebte,achte,neunte,zehnte",
        "time": "mal",
        "seconds": "s,sek,sekunde,sekunden",
        "minutes": "min,minute,minuten",
        "at": "bei,nach,um,in,ab",
        "start": "am anfang,zu beginn,anfangs",
        "recently": "gerade eben,soeben,gerade,jetzt,eben",
        "filler": (
            "bild,oder,richtig,bitte,hallo,hey,sag mir,kannst du mir sagen,konntest du mir sagen,weisst du,"
            "ich mochte wissen,der,die,das,den,dem,ein,eine,einen,einem,einer,zu,zum,zur,fur,mit,und,von,es,denn,"
            "eigentlich,an,auf,am,im,in,so,doch,mal,je,jemals,ob,dass,insgesamt,auch,noch,nur,wieder,sekunde,ja,dazu,"
            "des,nun,alle,alles,aufgehort,dort,welche"
        ),
    },
    {
        "because": ", denn",
        "and": "und",
        "at": "bei {at} s",
        "ago": "vor {ago} Sekunden",
        "just_now": "gerade eben",
        "then": "{when}: {clause}",
        "person": "Person {id}",
        "somebody": "jemand",
        "anybody": "irgendjemanden",
        "yes": "Ja",
        "no": "Nein",
        "unknown": "Das weiß ich nicht",
        "unclear": "Ich verstehe die Frage nicht sicher",
        "not_recorded": "die Aufzeichnung sagt es nicht",
        "belief": "ich glaubte {what}",
        "no_belief": "ich glaubte nicht {what}",
        "saw_none": "ich sah niemanden",
        "saw_one": "ich sah {people}",
        "away": "{person} in {distance} m Entfernung",
        "nobody_came": "niemand war hier",
        "here": "{person} war von {at} bis {until} s hier",
        "here_you": "du warst von {at} bis {until} s hier",
        "counted": "{count} Personen waren hier",
        "counted_one": "eine Person war hier",
        "times": "{count} Mal",
        "times_one": "einmal",
        "said": "ich sagte „{what}“",
        "said_nothing": "ich sagte nichts",
        "nothing_next": "ich hatte keine Absicht",
        "next_was": "das Nächste war {when}: {clause}",
        "last_was": "das Letzte war {when}: {clause}",
        "nothing_done": "ich tat gerade nichts",
        "wanted": "ich wollte {what}",
        "assumes": "Ich halte dich für Person {id}.",
        "examples": (
            "Was siehst du? | Was hast du bei Sekunde {at} gemacht? | Wer war hier? | Was machst du als Nächstes?"
        ),
    },
)

FRENCH = Language(
    "fr",
    {
        "why": (
            "pourquoi,pour quelle raison,quelle raison,raison,comment se fait il,qu est ce qui t a pousse,explique,"
            "a cause de quoi,dans quel but"
        ),
        "what": "que,quoi,qu est ce que,qu est ce qu,qu,quelque chose,decris,quelle,quel",
        "who": "qui,quelles personnes,quels visiteurs,quelle personne,quel robot,quel agent,qui est ce que",
        "when": "quand,a quelle heure,a quel moment,depuis quand",
        "how_often": "combien de fois,a quelle frequence",
        "how_many": "combien de,combien,nombre de",
        "unanswerable": "ou,d ou,combien de temps,depuis combien,quel age,quelle couleur,a qui,comment,combien coute",
        "not": "pas,jamais,aucun,aucune,oublie,omis,refuse,sans",
        "see": (
            "vois,voyez,voir,vu,voyais,apercois,remarque,apercu,devant toi,devant vous,visible,observes,observe,camera"
        ),
        "do": "fais,faites,faire,fait,faisais,occupe,fabriques",
        "happen": "passe,arrive,passait,produit",
        "next": "ensuite,apres,prochaine,prochain,suite,suivant",
        "plan": "comptes,prevois,veux,vas,allez,intention,but,objectif,plan,voulez,feras,projet",
        "say": "dis,dit,dire,dites,parle",
        "here": "ici,la,venu,venue,venus,passe,present,presente,visite,arrive,parti",
        "people": (
            "gens,personnes,personne,visiteur,visiteurs,visiteuse,homme,femme,quelqu un,invite,invites,humain,enfant"
        ),
        "nobody": "personne n",
        "me": "me,m,moi,je,j,nous,mon",
        "you": "tu,te,t,vous,toi,waldo,robot",
        "them": "lui,elle,l,le,la,les,il,ils,eux",
        "past": "as,avez,a,ai,ont,etait,etaient,etais,ete,viens,deja,auparavant,est venu",
        "future": "vas,allez,feras,ferez,prochaine,ensuite",
        "present": "est,es,sont,peux,maintenant,actuellement,vois,fais,en train",
        "ago": "il y a",
        "first": "premier,premiere,d abord",
        "last": "dernier,derniere",
        "ordinals": "deuxieme,troisieme,quatrieme,cinquieme,sixieme,septieme,huitieme,neuvieme,dixieme",
        "time": "fois",
        "seconds": "s,sec,seconde,secondes",
        "minutes": "min,minute,minutes",
        "at": "a,apres,vers,au bout de,dans",
        "start": "au debut,au commencement",
        "recently": "a l instant,juste,maintenant",
        "filler": (
            "s il te plait,s il vous plait,bonjour,dis moi,dites moi,peux tu me dire,pouvez vous me dire,sais tu,le,"
            "la,les,l,un,une,des,de,du,d,a,au,aux,et,en,ce,c,cela,ca,que,qu,est ce,pour,mon,ma,votre,ton,ne,n,y,est,"
            "dans,sur,avec,son,sa,il,on,train,si,se,s,seconde,t,fois,total,quel,quelle"
        ),
    },
    {
        "because": " car",
        "and": "et",
        "at": "à {at} s",
        "ago": "il y a {ago} secondes",
        "just_now": "à l'instant",
        "then": "{when}, {clause}",
        "person": "la personne {id}",
        "somebody": "quelqu'un",
        "anybody": "qui que ce soit",
        "yes": "Oui",
        "no": "Non",
        "unknown": "Je ne sais pas",
        "unclear": "Je ne suis pas sûr de comprendre la question",
        "not_recorded": "l'enregistrement ne le dit pas",
        "belief": "je croyais {what}",
        "no_belief": "je ne croyais pas {what}",
        "saw_none": "je ne voyais personne",
        "saw_one": "je voyais {people}",
        "away": "{person} à {distance} m",
        "nobody_came": "il n'y avait personne",
        "here": "{person} était là de {at} à {until} s",
        "here_you": "vous étiez là de {at} à {until} s",
        "counted": "{count} personnes étaient là",
        "counted_one": "une personne était là",
        "times": "{count} fois",
        "times_one": "une fois",
        "said": "j'ai dit « {what} »",
        "said_nothing": "je n'ai rien dit",
        "nothing_next": "je n'avais aucune intention",
        "next_was": "la suite était {when} : {clause}",
        "last_was": "la dernière chose était {when} : {clause}",
        "nothing_done": "je ne faisais rien",
        "wanted": "je voulais {what}",
        "assumes": "Je vous prends pour la personne {id}.",
        "examples": "Que vois-tu ? | Qu'as-tu fait à {at} secondes ? | Qui était là ? | Que vas-tu faire ensuite ?",
    },
)

SPANISH = Language(
    "es",
    {
        "why": (
            "por que,por que razon,por cual motivo,razon,motivo,a que se debe,como es que,explica,para que,"
            "que te hizo,que te llevo"
        ),
        "what": "que,que cosa,algo,describe,cual",
        "who": "quien,quienes,a quien,a quienes,que personas,que persona,que visitantes,que robot,que agente",
        "when": "cuando,a que hora,en que momento,desde cuando",
        "how_often": "cuantas veces,con que frecuencia,cada cuanto",
        "how_many": "cuantas,cuantos,cuanta,numero de",
        "unanswerable": "donde,adonde,cuanto tiempo,que edad,que color,de quien,como,cuanto",
        "not": "no,nunca,jamas,ningun,ninguna,tampoco,sin,olvidaste",
        "see": "ves,viste,ver,visto,veias,miras,notas,notaste,delante de ti,visible,observas,observaste,camara,ve",
        "do": "haces,hiciste,hacer,hecho,hacias,haras,hace,ocupado,haciendo",
        "happen": "pasa,paso,pasado,ocurre,ocurrio,sucedio",
        "next": "despues,luego,siguiente,proximo,proxima,a continuacion",
        "plan": "planeas,piensas,quieres,vas a,intencion,objetivo,plan,meta,pretendes,haras",
        "say": "dices,dijiste,decir,dicho,hablaste",
        "here": "aqui,aca,ahi,vino,vinieron,estuvo,estuvieron,llego,visito,presente,alli,vine",
        "people": "gente,persona,personas,visitante,visitantes,hombre,mujer,alguien,invitado,humano,nino",
        "nobody": "nadie",
        "me": "me,mi,yo,nos,nosotros,conmigo",
        "you": "tu,te,ti,usted,waldo,robot,vosotros",
        "them": "lo,la,le,los,les,ella,el,ellos",
        "past": (
            "vino,vinieron,llego,has,he,ha,han,fue,era,estaba,estaban,estuvo,hiciste,viste,dijiste,habia,ya,antes,"
            "hasta ahora"
        ),
        "future": "vas a,haras,proximo,siguiente,despues,va a",
        "present": "estas,es,son,puedes,ahora,actualmente,ves,haces,esta",
        "ago": "hace",
        "first": "primero,primera,primer,al principio",
        "last": "ultimo,ultima",
        "ordinals": "segundo,tercero,cuarto,quinto,sexto,septimo,octavo,noveno,decimo",
        "time": "vez,veces",
        "seconds": "s,seg,segundo,segundos",
        "minutes": "min,minuto,minutos",
        "at": "a,en,despues de,tras,sobre",
        "start": "al principio,al comienzo,al inicio",
        "recently": "ahora mismo,hace un momento,recien,ahora",
        "filler": (
            "por favor,hola,oye,dime,puedes decirme,podrias decirme,sabes,quiero saber,el,la,los,las,un,una,unos,de,"
            "del,a,al,y,en,con,lo,le,se,es,que,para,su,tu,esto,eso,segundo,mi,ese,si,veces,vez,en total,o"
        ),
    },
    {
        "because": " porque",
        "and": "y",
        "at": "a los {at} s",
        "ago": "hace {ago} segundos",
        "just_now": "hace un momento",
        "then": "{when} {clause}",
        "person": "la persona {id}",
        "somebody": "alguien",
        "anybody": "nadie",
        "yes": "Sí",
        "no": "No",
        "unknown": "No lo sé",
        "unclear": "No estoy seguro de entender la pregunta",
        "not_recorded": "el registro no lo dice",
        "belief": "yo creía {what}",
        "no_belief": "yo no creía {what}",
        "saw_none": "no veía a nadie",
        "saw_one": "veía a {people}",
        "away": "{person} a {distance} m",
        "nobody_came": "no hubo nadie aquí",
        "here": "{person} estuvo aquí de {at} a {until} s",
        "here_you": "estuviste aquí de {at} a {until} s",
        "counted": "{count} personas estuvieron aquí",
        "counted_one": "una persona estuvo aquí",
        "times": "{count} veces",
        "times_one": "una vez",
        "said": "dije «{what}»",
        "said_nothing": "no dije nada",
        "nothing_next": "no tenía ninguna intención",
        "next_was": "lo siguiente fue {when}: {clause}",
        "last_was": "lo último fue {when}: {clause}",
        "nothing_done": "no hacía nada",
        "wanted": "yo quería {what}",
        "assumes": "Te tomo por la persona {id}.",
        "examples": "¿Qué ves? | ¿Qué hiciste a los {at} segundos? | ¿Quién estuvo aquí? | ¿Qué harás después?",
    },
)

LANGUAGES = {language.code: language for language in (ENGLISH, GERMAN, FRENCH, SPANISH)}
